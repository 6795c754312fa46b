"""The largest balls that touch a surface from inside (Ma, Bae and Choi 2012), and how far a place lies in a
tube by them.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from ..arrays import Array

ROUNDS = 40  # each takes a point out of a ball; all are empty after ten or twenty
LEAF = 64  # points: centres are far from the surface, so that large leaves save half of the time
SAME = 1e-3  # of the radius: by so much rounding lets the ball's own point be inside
WIDE = 0.6  # of the largest: a ball of the chamber; veins are half as wide or less


def inner_balls(at: Array, normals: Array, points: Array) -> tuple[Array, Array]:
    """Return centre (m, d) and radius (m,) of the largest ball inside `points` (n, d) of a surface that
    touches it at each place `at` (m, d), where the unit `normals` (m, d) point outward.
    """
    tree = cKDTree(points, leafsize=LEAF)
    radius = np.full(len(at), float(np.ptp(points, axis=0).min()) / 2)  # none inside is larger
    left = np.arange(len(at))  # balls that still hold points
    for _ in range(ROUNDS):
        gap, nearest = tree.query(at[left] - radius[left, None] * normals[left])
        away = at[left] - points[nearest]
        height = (away * normals[left]).sum(axis=1)
        smaller = (gap < (1.0 - SAME) * radius[left]) & (height > 0.0)
        left = left[smaller]
        if not len(left):
            break
        radius[left] = (away[smaller] ** 2).sum(axis=1) / (2.0 * height[smaller])
    return at - radius[:, None] * normals, radius


def depth_in_tubes(at: Array, normals: Array, points: Array) -> Array:
    """Return how far (m,) each place lies from the chamber: from the nearest of the balls inside the surface
    that are at least `WIDE` times as wide as the widest. Parameters as in `inner_balls`.
    """
    centre, radius = inner_balls(at, normals, points)
    wide = radius >= WIDE * radius.max()
    gap = cdist(at, centre[wide]) - radius[wide]
    return np.asarray(np.maximum(gap.min(axis=1), 0.0))
