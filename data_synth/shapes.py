"""Shapes as functions from points (n, d) to signed distances (n,), negative inside; blends are functions of
shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Shape = Callable[[Array], Array]


def ball(centre: ArrayLike, radius: float) -> Shape:
    """Disc or ball; exact."""
    return lambda p: np.asarray(np.linalg.norm(p - np.asarray(centre), axis=1)) - radius


def half_space(normal: ArrayLike, offset: float) -> Shape:
    """All x with normal @ x <= offset, for a unit normal; exact."""
    return lambda p: np.asarray(p @ np.asarray(normal) - offset)


def ellipsoid(axes: ArrayLike) -> Shape:
    """Ellipsoid about the origin with the given half axes; exact.

    The foot of the perpendicular from y is a_i^2 y_i / (t + a_i^2), with t the largest root of sum (a_i y_i /
    (t + a_i^2))^2 = 1. The sum falls and is convex there, so that Newton's steps from below never overshoot.
    """
    a = np.asarray(axes, dtype=np.float64)

    def distance(p: Array) -> Array:
        # by symmetry; never on a plane of symmetry, where the root is double
        y = np.maximum(np.abs(p), 1e-9 * a.max())
        t = (a * y - a**2).max(axis=1)  # one term is 1 here, so the sum is at least that
        for _ in range(8):
            terms = (a * y / (t[:, None] + a**2)) ** 2
            t += (terms.sum(axis=1) - 1.0) / (2.0 * terms / (t[:, None] + a**2)).sum(axis=1)
        foot = a**2 * y / (t[:, None] + a**2)
        return np.asarray(
            np.linalg.norm(y - foot, axis=1) * np.where(((y / a) ** 2).sum(axis=1) < 1.0, -1.0, 1.0)
        )

    return distance


def round_cone(start: ArrayLike, end: ArrayLike, start_radius: float, end_radius: float) -> Shape:
    """Hull of two balls; exact while neither holds the other."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    sine = (start_radius - end_radius) / length  # of the angle between the axis and the flank
    cosine = np.sqrt(1.0 - sine**2)

    def distance(p: Array) -> Array:
        along = (p - a) @ (b - a) / length
        beside = np.sqrt(np.maximum(((p - a) ** 2).sum(axis=1) - along**2, 0.0))
        # position along the flank, counted from where it leaves the first ball
        down = along * cosine - beside * sine
        flank = along * sine + beside * cosine - start_radius
        at_end = np.hypot(along - length, beside) - end_radius
        return np.asarray(
            np.where(
                down < 0.0,
                np.hypot(along, beside) - start_radius,
                np.where(down > length * cosine, at_end, flank),
            )
        )

    return distance


def polygon(corners: ArrayLike) -> Shape:
    """Inside of a closed polygon in 2D, corners (m, 2) in either direction; exact."""
    a = np.asarray(corners, dtype=np.float64)
    b = np.roll(a, -1, axis=0)

    def distance(p: Array) -> Array:
        squared = np.full(len(p), np.inf)
        inside = np.zeros(len(p), dtype=bool)
        for start, end in zip(a, b, strict=True):
            edge, to = end - start, p - start
            t = np.clip(to @ edge / (edge @ edge), 0.0, 1.0)
            squared = np.minimum(squared, ((to - t[:, None] * edge) ** 2).sum(axis=1))
            crossed = (start[1] > p[:, 1]) != (end[1] > p[:, 1])  # by the ray to the right
            inside ^= crossed & ((edge[0] * to[:, 1] - edge[1] * to[:, 0]) * np.sign(edge[1]) > 0.0)
        return np.asarray(np.sqrt(squared) * np.where(inside, -1.0, 1.0))

    return distance


def revolve(profile: Shape) -> Shape:
    """Body of revolution about z of a 2D shape in (radius, z) that is symmetric in the radius; exact where
    the profile is.
    """
    return lambda p: profile(np.column_stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]]))


def move(shape: Shape, offset: ArrayLike) -> Shape:
    """The shape shifted by a vector."""
    return lambda p: shape(p - np.asarray(offset))


def grow(shape: Shape, by: float) -> Shape:
    """The shape thickened by a length, its edges rounded."""
    return lambda p: shape(p) - by


def union(*shapes: Shape, blend: float = 0.0) -> Shape:
    """What any of the shapes covers; a fillet of the given width fills the grooves and is no exact distance
    there.
    """
    return lambda p: reduce(lambda f, g: _soft_minimum(f, g, blend), [shape(p) for shape in shapes])


def intersection(*shapes: Shape, blend: float = 0.0) -> Shape:
    """What all of the shapes cover, its edges rounded by `blend`."""
    return lambda p: -reduce(lambda f, g: _soft_minimum(f, g, blend), [-shape(p) for shape in shapes])


def chain(centres: Sequence[ArrayLike], radii: Sequence[float], blend: float = 0.0) -> Shape:
    """A bent tube through balls of the given centres and radii."""
    parts = zip(centres[:-1], centres[1:], radii[:-1], radii[1:], strict=True)
    return union(*(round_cone(*part) for part in parts), blend=blend)


def _soft_minimum(f: Array, g: Array, width: float) -> Array:
    """Minimum with the corner rounded where |f - g| < width; lower than the minimum by at most width / 4."""
    if width == 0.0:
        return np.minimum(f, g)
    overlap = np.maximum(width - np.abs(f - g), 0.0)
    return np.minimum(f, g) - overlap**2 / (4.0 * width)


def gradient(shape: Shape, points: Array, step: float = 1e-3) -> Array:
    """Gradient (n, d) of a shape by central differences."""
    steps = step * np.eye(points.shape[1])
    return np.column_stack([(shape(points + e) - shape(points - e)) / (2.0 * step) for e in steps])


def project(shape: Shape, points: Array, rounds: int = 3) -> Array:
    """Points near the surface moved onto it along the gradient."""
    for _ in range(rounds):
        slope = gradient(shape, points)
        points = points - (shape(points) / (slope**2).sum(axis=1))[:, None] * slope
    return points
