"""Families of motion that fill space: the flow of a random velocity, and a piston."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from o3dls import Surface

from . import motion as moves
from .shapes import Array

Bundle = Callable[[float], Array]  # where the vertices (n, 3) lie for a share of the motion; 0 is at rest

LENGTHS = ((8.0, 14.0), (16.0, 26.0), (30.0, 50.0))  # mm, from which a flow's correlation lengths are drawn
WAVES = 40  # per length
STEPS = 6  # of the midpoint rule, over the whole flow


def flow(rng: np.random.Generator, rest: Surface) -> Bundle:
    """A stationary velocity that all points follow for one unit of time, hence a diffeomorphism.

    The velocity is a sum of three random fields of Gaussian spectrum; drawn are their lengths (8 to 14, 16 to
    26, 30 to 50 mm) and by which power of the length, 0.2 to 0.8, the longer ones are stronger.
    """
    power = rng.uniform(0.2, 0.8)
    lengths = [float(np.exp(rng.uniform(*np.log(bounds)))) for bounds in LENGTHS]
    waves = np.vstack([rng.normal(size=(WAVES, 3)) / length for length in lengths])
    phase = rng.uniform(0.0, 2.0 * np.pi, len(waves))
    strength = np.repeat(np.array(lengths) ** power, WAVES) / lengths[1] ** power
    weights = np.sqrt(2.0 / WAVES) * strength[:, None] * rng.normal(size=(len(waves), 3))
    middle = rest.vertices.mean(axis=0)

    def velocity(p: Array) -> Array:
        return np.asarray(np.cos((p - middle) @ waves.T + phase) @ weights)

    def moved(share: float) -> Array:
        p, step = rest.vertices, share / STEPS
        for _ in range(STEPS):
            p = p + step * velocity(p + 0.5 * step * velocity(p))
        return np.asarray(p)

    return moved


def piston(rng: np.random.Generator, rest: Surface) -> Bundle:
    """One side of the chamber is pushed along an axis, and a belt across it contracts (or both the other
    way), so that the volume changes.

    Drawn are the axis, where the push sets in and over how many radii it grows, where the belt lies and how
    wide it is, and its contraction relative to the push. A radius is the rms distance from the middle. The
    contraction fades beyond a radius from the axis; none of this is linear in position.
    """
    middle = rest.vertices.mean(axis=0)
    radius = moves.rms(rest.vertices - middle)
    axis = moves.direction(rng)
    sign = rng.choice([-1.0, 1.0])
    onset, growth = rng.uniform(-0.5, 0.1), rng.uniform(0.6, 1.0)
    belt, width = rng.uniform(-0.4, 0.4), rng.uniform(0.6, 1.0)
    contraction = rng.uniform(0.5, 1.2)

    def moved(share: float) -> Array:
        along = (rest.vertices - middle) @ axis / radius
        across = (rest.vertices - middle) / radius - along[:, None] * axis
        push = _smooth_step((along - onset) / growth)
        squeeze = _bump((along - belt) / width) / (1.0 + (across**2).sum(axis=1))
        shift = push[:, None] * axis + contraction * squeeze[:, None] * across
        return np.asarray(rest.vertices - sign * share * shift)

    return moved


def _smooth_step(x: Array) -> Array:
    """0 below 0, 1 above 1, with two continuous derivatives."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


def _bump(x: Array) -> Array:
    """1 at 0, 0 beyond -1 and 1, with two continuous derivatives."""
    return _smooth_step(1.0 - np.abs(x))
