"""Compiled loops over the faces of many surfaces that share them: volumes, and areas by vertex."""

from __future__ import annotations

import numpy as np
from numba import njit

from ... import parallel
from ...arrays import Array, Ints

ROWS = 8  # surfaces that are worth a thread


def measure_areas(
    vertices: Array, faces: Ints, thresholds: tuple[float, ...], values: Array | None
) -> tuple[Array, Array]:
    """Return the volumes (k,) in mm³ of surfaces with vertices (k, n, 3), and each vertex's share (k, 2 + t,
    n) of the area in mm²: of all; of that where values (k, n) are known; and of that where these lie below
    each of t thresholds. Without values, areas are (k, 2, n).
    """
    low = np.array(thresholds if values is not None else (), dtype=np.float64)
    given = np.full((len(vertices), 1), np.nan) if values is None else values
    volume = np.zeros(len(vertices))
    areas = np.zeros((len(vertices), 2 + len(low), vertices.shape[1]))
    parallel.by_rows(_fill_areas, ROWS, (vertices, given, volume, areas), faces, low)
    return volume, areas


def share_below(corners: Array, threshold: float) -> Array:
    """Return the share (m,) of the area of triangles in which a field lies below a threshold that is linear
    on each, with values (m, 3) at the corners; 0 where one is not known.
    """
    found = np.zeros(len(corners))
    _fill_shares(np.asarray(corners, dtype=np.float64), threshold, found)
    return found


@njit(cache=True, nogil=True)
def _fill_areas(vertices, values, volume, areas, faces, low):  # type: ignore[no-untyped-def]
    for k in range(len(vertices)):
        at, value = vertices[k], values[k]
        mapped = len(value) == len(at)
        o = at[faces[0, 0]]  # volumes are sums of tetrahedra from here
        for i, j, m in faces:
            ax, ay, az = at[j, 0] - at[i, 0], at[j, 1] - at[i, 1], at[j, 2] - at[i, 2]
            bx, by, bz = at[m, 0] - at[i, 0], at[m, 1] - at[i, 1], at[m, 2] - at[i, 2]
            x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            volume[k] += ((at[i, 0] - o[0]) * x + (at[i, 1] - o[1]) * y + (at[i, 2] - o[2]) * z) / 6.0
            third = (x * x + y * y + z * z) ** 0.5 / 6.0
            for corner in (i, j, m):
                areas[k, 0, corner] += third
            if mapped and np.isfinite(value[i] + value[j] + value[m]):
                for corner in (i, j, m):
                    areas[k, 1, corner] += third
                for t in range(len(low)):
                    share = third * _share_of_face(value[i], value[j], value[m], low[t])
                    for corner in (i, j, m):
                        areas[k, 2 + t, corner] += share


@njit(cache=True, nogil=True)
def _fill_shares(corners, threshold, found):  # type: ignore[no-untyped-def]
    for k in range(len(corners)):
        a, b, c = corners[k]
        if np.isfinite(a + b + c):
            found[k] = _share_of_face(a, b, c, threshold)


@njit(cache=True, nogil=True)
def _share_of_face(a, b, c, threshold):  # type: ignore[no-untyped-def]
    low, high = min(a, b, c), max(a, b, c)
    if high < threshold:
        return 1.0
    if low >= threshold:
        return 0.0
    middle = max(min(a, b), min(max(a, b), c))
    if threshold <= middle:  # a corner is cut off, below the threshold or above it
        return (threshold - low) ** 2 / ((high - low) * (middle - low))
    return 1.0 - (high - threshold) ** 2 / ((high - low) * (high - middle))
