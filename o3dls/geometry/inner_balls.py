"""The largest balls that touch a surface from inside (Ma, Bae and Choi 2012), and how far a place lies in a
tube by them.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..arrays import Array
from ..parallel import by_rows
from .bounding_box_tree import box_gap
from .closest_point import STACK, ClosestPoint

# a point seen from the place within 2.6 degrees of the tangent plane does not bound the ball: rounding and
# uneven normals put the place's own neighbours there
GRAZING = 0.045
WIDE = 0.6  # of the largest: a ball of the chamber; veins are half as wide or less
WORTH = 200  # places of a thread
CLOSE = 1e-9  # of a squared radius: rounding leaves no point unseen


def inner_balls(at: Array, normals: Array, points: Array) -> tuple[Array, Array]:
    """Return centre (m, 3) and radius (m,) of the largest ball inside `points` (n, 3) of a surface that
    touches it at each place `at` (m, 3), where the unit `normals` (m, 3) point outward.

    A ball that touches at x and passes through p, seen from x at the distance d and the height h below the
    tangent plane, has the radius d^2 / (2 h): the largest without points inside has the least of these.
    """
    radius = np.full(len(at), float(np.ptp(points, axis=0).min()) / 2)  # none inside is larger
    alone = np.repeat(np.arange(len(points))[:, None], 3, axis=1)  # faces of one corner
    by_rows(_shrink_radii, WORTH, (at, normals, radius), *ClosestPoint(points, alone).face_tree)
    return at - radius[:, None] * normals, radius


@njit(cache=True, nogil=True)
def _shrink_radii(at, normals, radius, points, leaves, boxes):  # type: ignore[no-untyped-def]
    """Shrink balls (m,) until no point is inside; only boxes that reach into a ball are opened."""
    count, waiting = len(points), np.empty(STACK, dtype=np.int64)
    for i in range(len(at)):
        least = radius[i]
        waiting[0], top = 0, 1
        while top > 0:
            top -= 1
            node = waiting[top]
            x = at[i, 0] - least * normals[i, 0]
            y = at[i, 1] - least * normals[i, 1]
            z = at[i, 2] - least * normals[i, 2]
            if box_gap(x, y, z, boxes, node) > (1.0 + CLOSE) * least * least:
                continue
            if node < leaves - 1:  # the nearer side first: what it holds shrinks the ball before the other
                near, far = 2 * node + 1, 2 * node + 2
                if box_gap(x, y, z, boxes, far) < box_gap(x, y, z, boxes, near):
                    near, far = far, near
                waiting[top], waiting[top + 1] = far, near
                top += 2
                continue
            leaf = node - (leaves - 1)
            for k in range(leaf * count // leaves, (leaf + 1) * count // leaves):
                x, y, z = at[i, 0] - points[k, 0, 0], at[i, 1] - points[k, 0, 1], at[i, 2] - points[k, 0, 2]
                height = x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2]
                squared = x * x + y * y + z * z
                inside = 2.0 * least * height > squared  # of the ball so far
                if inside and height * height > GRAZING**2 * squared:
                    least = squared / (2.0 * height)
        radius[i] = least


def depth_in_tubes(at: Array, normals: Array, points: Array) -> Array:
    """Return how far (m,) each place lies from the chamber: from the nearest of the balls inside the surface
    that are at least `WIDE` times as wide as the widest. Parameters as in `inner_balls`.
    """
    centre, radius = inner_balls(at, normals, points)
    wide = radius >= WIDE * radius.max()
    gap = np.full(len(at), np.inf)
    by_rows(_lower_gaps, WORTH, (at, gap), centre[wide], radius[wide])
    return np.asarray(np.maximum(gap, 0.0))


@njit(cache=True, nogil=True)
def _lower_gaps(at, gap, centre, radius):  # type: ignore[no-untyped-def]
    """Lower gaps (m,) to the least distance from balls; a root is only taken of one that is nearer."""
    for i in range(len(at)):
        least = gap[i]
        for k in range(len(centre)):
            x, y, z = at[i, 0] - centre[k, 0], at[i, 1] - centre[k, 1], at[i, 2] - centre[k, 2]
            squared = x * x + y * y + z * z
            reach = least + radius[k]
            if reach > 0.0 and squared < reach * reach:
                least = np.sqrt(squared) - radius[k]
        gap[i] = least
