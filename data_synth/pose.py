"""Poses: the similarity nearest to pairs of points, and how far off a start is."""

from __future__ import annotations

import numpy as np

from . import motion as moves
from .motion import Motion
from .shapes import Array

ANGLE, SHIFT, SCALE = (3.0, 10.0), (3.0, 10.0), (0.95, 1.05)  # degrees, mm: how far off a rough pose is


def matrix(linear: Array, shift: Array) -> Array:
    """Homogeneous matrix (4, 4) of x -> linear @ x + shift."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = linear, shift
    return found


def under(pose: Array, points: Array) -> Array:
    """Points (n, 3) under a homogeneous matrix."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def similarity_of(rest: Array, moved: Array, weights: Array | None = None) -> Array:
    """The similarity (4, 4) that takes points (n, 3) nearest to where they have moved."""
    weights = np.ones(len(rest)) if weights is None else weights
    share = (weights / weights.sum())[:, None]
    a, b = (share * rest).sum(axis=0), (share * moved).sum(axis=0)
    u, sizes, vt = np.linalg.svd((share * (moved - b)).T @ (rest - a))
    sides = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = (sizes @ sides) / (share * (rest - a) ** 2).sum()
    linear = scale * (u * sides) @ vt
    return matrix(linear, b - linear @ a)


def nearest_similarity(rest: Array, moved: Array) -> Motion:
    """The same as a motion."""
    pose = similarity_of(rest, moved)
    return lambda p: under(pose, p)


def frame(rng: np.random.Generator) -> Array:
    """A rigid matrix from a file's frame into a mapping system's: turned by up to 30 degrees, shifted by 50
    mm.
    """
    return matrix(moves.turn(rng, np.deg2rad(rng.uniform(0.0, 30.0))), 50.0 * moves.direction(rng))


def rough(rng: np.random.Generator, about: Array) -> Array:
    """A rigid error of 3 to 10 degrees about a point (3,) and 3 to 10 mm."""
    turned = moves.turn(rng, np.deg2rad(rng.uniform(*ANGLE)))
    return matrix(turned, about - turned @ about + rng.uniform(*SHIFT) * moves.direction(rng))
