"""Polygons and strips of files cut into triangles."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import ROUNDING, Array, Ints

Indices = NDArray[Any]  # float64 where they were read among other numbers, and not yet checked
STARTS = 16  # corners that are tried as the first of a fan


def strips(blocks: Iterable[Array]) -> list[Array]:
    """Return triangles of blocks of triangle strips; every second one is turned."""
    parts = []
    for block in blocks:
        for k in range(block.shape[1] - 2):
            parts.append(block[:, [k, k + 1, k + 2] if k % 2 == 0 else [k + 1, k, k + 2]])
    return parts


def triangulate(vertices: Array, *polygons: Indices) -> tuple[Indices, Ints]:
    """Return triangles (m, 3) of blocks of polygons, each block (k, n) with n corners, and the polygon (m,)
    that each is cut from, counted through the blocks.
    """
    triangles: list[Indices] = [np.zeros((0, 3), dtype=np.int64)]
    owners: list[Ints] = [np.zeros(0, dtype=np.int64)]
    first = 0
    for block in polygons:
        size = block.shape[1] - 2
        if size > 0:
            cut = _cut_polygons(vertices, block) if size > 1 else block
            triangles.append(cut.reshape(-1, 3))
            owners.append(first + np.repeat(np.arange(len(block)), size))
        first += len(block)
    return np.concatenate(triangles), np.concatenate(owners)


def _cut_polygons(vertices: Array, polygons: Indices) -> Indices:
    """Cut polygons (k, n) into triangles (k, n - 2, 3): fans, begun at a corner from where they fold nowhere;
    ears, where every fan folds.
    """
    polygons = polygons.copy()
    left = np.arange(len(polygons) if len(vertices) else 0)
    n = polygons.shape[1]
    for _ in range(min(n, STARTS)):
        left = left[_fan_folds(_corner_places(vertices, polygons[left]))]
        if len(left) == 0:
            break
        polygons[left] = np.roll(polygons[left], -1, axis=1)
    triangles = np.stack([polygons[:, [0, k, k + 1]] for k in range(1, n - 1)], axis=1)
    for row in left:
        triangles[row] = polygons[row][_clip_ears(_project_in_plane(_corner_places(vertices, polygons[row])))]
    return triangles


def _corner_places(vertices: Array, corners: Indices) -> Array:
    """Return where corners lie; what is no index is refused where the surface is made."""
    with np.errstate(invalid="ignore"):
        return vertices.take(corners.astype(np.int64), axis=0, mode="clip")


def _fan_areas(corners: Array) -> Array:
    """Return twice the area vectors (..., n - 2, 3) of the fan from the first of corners (..., n, 3)."""
    spokes = corners[..., 1:, :] - corners[..., :1, :]
    return np.asarray(np.cross(spokes[..., :-1, :], spokes[..., 1:, :]))


def _fan_folds(corners: Array) -> NDArray[np.bool_]:
    """Return whether the fan (k,) from the first of corners (k, n, 3) has a triangle against the polygon's
    sense.
    """
    with np.errstate(all="ignore"):  # what is not finite is refused where the surface is made
        areas = _fan_areas(corners)
        whole = areas.sum(axis=1, keepdims=True)
        along = (areas * whole).sum(axis=2)
        return np.asarray((along < -ROUNDING * (whole * whole).sum(axis=2)).any(axis=1))


def _project_in_plane(corners: Array) -> Array:
    """Return corners (n, 3) of a polygon in its plane, (n, 2), counter-clockwise."""
    normal = _fan_areas(corners).sum(axis=0)
    normal = normal / np.linalg.norm(normal)
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    return np.asarray((corners - corners[0]) @ np.column_stack([u, np.cross(normal, u)]))


def _clip_ears(xy: Array) -> list[list[int]]:
    """Return the n - 2 triangles of a polygon (n, 2), by ear clipping (Meisters 1975).

    Where it crosses itself, which no triangles fit, the most convex corner passes for an ear: it stays a
    fold.
    """
    ring = list(range(len(xy)))
    triangles = []
    ear = 0
    while len(ring) > 3:
        order = [*range(ear, len(ring)), *range(ear)]
        ear = next((k for k in order if _is_ear(xy, ring, k)), -1)
        if ear < 0:
            ear = max(order, key=lambda k: _signed_area(*xy[_corner_triangle(ring, k)]))
        triangles.append(_corner_triangle(ring, ear))
        del ring[ear]
    return [*triangles, ring]


def _corner_triangle(ring: list[int], k: int) -> list[int]:
    """Return a corner of the ring between its neighbours."""
    return [ring[k - 1], ring[k], ring[(k + 1) % len(ring)]]


def _is_ear(xy: Array, ring: list[int], k: int) -> bool:
    """Return whether the corner is convex, and no other lies in the triangle with its neighbours; some may
    lie at the same place, as where a cut leads to a hole.
    """
    a, b, c = xy[_corner_triangle(ring, k)]
    if (
        _signed_area(a, b, c) <= ROUNDING * np.ptp(xy, axis=0).prod()
    ):  # the corner is straight, but for rounding
        return False
    others = xy[ring]
    apart = (others != a).any(axis=1) & (others != b).any(axis=1) & (others != c).any(axis=1)
    sides = (_signed_area(a, b, others), _signed_area(b, c, others), _signed_area(c, a, others))
    return not (apart & (np.min(sides, axis=0) >= 0.0)).any()


def _signed_area(a: Array, b: Array, c: Array) -> Array:
    """Return twice the area of triangles a b c, positive counter-clockwise."""
    ab, ac = b - a, c - a
    return np.asarray(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])
