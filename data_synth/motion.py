"""Motions as functions from points (n, d) to points; each is smooth and, at the sizes used here, without
folds.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from .shapes import Array

Motion = Callable[[Array], Array]


def then(*motions: Motion) -> Motion:
    """One motion after the other."""

    def moved(p: Array) -> Array:
        for motion in motions:
            p = motion(p)
        return p

    return moved


def strain(factors: ArrayLike) -> Motion:
    """Stretch along the axes about the origin."""
    return lambda p: p * np.asarray(factors)


def tilt(axis: ArrayLike, angle: float, height: float) -> Motion:
    """What lies above z = 0 turns by `angle` (rad) about an axis through the origin, what lies below by as
    much the other way.

    The turn grows over about `height`.
    """
    unit = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)

    def moved(p: Array) -> Array:
        turn = angle * np.tanh(p[:, 2:] / height)
        along = (p @ unit)[:, None] * unit  # Rodrigues: the part along the axis stays
        return np.asarray(along + np.cos(turn) * (p - along) + np.sin(turn) * np.cross(unit, p))

    return moved


def drag(centres: ArrayLike, shifts: ArrayLike, width: float) -> Motion:
    """Gaussian shifts (k, d) about centres (k, d), of standard deviation `width`."""
    c, s = np.atleast_2d(centres), np.atleast_2d(shifts)
    return lambda p: p + np.exp(-((p[:, None] - c) ** 2).sum(axis=2) / (2.0 * width**2)) @ s


def blend(one: Motion, other: Motion, share: float, centres: Array, width: float) -> Motion:
    """One motion, but for a share of another about centres (k, d), within about `width`; a negative share
    leads away from the other.
    """

    def moved(p: Array) -> Array:
        near = np.exp(-((p[:, None] - centres) ** 2).sum(axis=2) / (2.0 * width**2)).sum(axis=1)
        return np.asarray(one(p) + share * np.tanh(near)[:, None] * (other(p) - one(p)))

    return moved


def wobble(rng: np.random.Generator, amplitude: float, length: float, dimension: int) -> Motion:
    """A random smooth shift: Gaussian field of standard deviation `amplitude` per axis and correlation length
    `length`.
    """
    waves = rng.normal(size=(200, dimension)) / length
    phase = rng.uniform(0.0, 2.0 * np.pi, 200)
    weights = amplitude * np.sqrt(2.0 / 200) * rng.normal(size=(200, dimension))
    return lambda p: p + np.cos(p @ waves.T + phase) @ weights


def bend(rng: np.random.Generator, rest: Array, way: float, length: float) -> Motion:
    """A random smooth shift over a correlation length, as large as needed: no rigid motion takes the points
    `rest` (n, d) nearer to where it puts them than `way` (rms). A field of fixed strength would leave a rigid
    fit little to miss on one seed and everything on another.
    """
    shift = wobble(rng, way, length, rest.shape[1])
    share = 1.0
    for _ in range(4):  # what is left is about proportional to the share: each step takes two digits
        share *= way / rms(no_rigid(rest, rest + share * (shift(rest) - rest)))
    return lambda p: p + share * (shift(p) - p)


def no_rigid(rest: Array, moved: Array) -> Array:
    """What is left (n, d) of a motion of points once the rigid motion nearest to it is taken out."""
    return moved - nearest_rigid(rest, moved)(rest)


def nearest_rigid(rest: Array, moved: Array) -> Motion:
    """The rigid motion that takes points (n, d) nearest to where they have moved."""
    a, b = rest.mean(axis=0), moved.mean(axis=0)
    u, _, vt = np.linalg.svd((moved - b).T @ (rest - a))
    return lambda p: np.asarray((p - a) @ (u @ vt).T + b)


def rms(shifts: Array) -> float:
    """Root mean square length of shifts (n, d)."""
    return float(np.sqrt((shifts**2).sum(axis=1).mean()))


def turn(rng: np.random.Generator, angle: float) -> Array:
    """Rotation matrix (3, 3) by `angle` (rad) about a random axis."""
    x, y, z = (axis := rng.normal(size=3)) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def direction(rng: np.random.Generator) -> Array:
    """Random unit vector (3,)."""
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))
