"""Values that belong to faces, carried to the vertices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import TINY, Array, Ints
from .surface import Surface


def at_vertices(surface: Surface, values: NDArray[Any]) -> Array:
    """Return the values per face, (m,) or (m, k), as values per vertex, (n,) or (n, k): NaN where no face has
    a value.

    Floating-point values become the mean over the faces around a vertex, weighted by their areas; missing
    ones (not finite) have no say. Whole numbers (of an integer type) are labels: the one with the largest
    area around the vertex, of equal ones the least; rows of several are one label.
    """
    corners = surface.faces.ravel()
    owner = np.repeat(np.arange(len(surface.faces)), surface.dimension)
    with np.errstate(over="ignore", invalid="ignore"):  # an area may be beyond all numbers
        # a face without area counts only where there is no other
        areas = np.maximum(surface.face_areas, TINY)[owner]
    rows = values.reshape(len(values), -1)
    n = len(surface.vertices)
    carry = _largest_label if values.dtype.kind in "iu" else _mean_at_vertices
    return carry(corners, rows, owner, areas, n).reshape(n, *values.shape[1:])


def _mean_at_vertices(corners: Ints, rows: Array, owner: Ints, areas: Array, n: int) -> Array:
    found = np.empty((n, rows.shape[1]))
    for k, column in enumerate(rows.T):
        known = np.isfinite(column)[owner]
        weight = np.bincount(corners[known], areas[known], n)
        with np.errstate(invalid="ignore", over="ignore"):  # 0 / 0 where nothing is known
            total = np.bincount(corners[known], areas[known] * column[owner][known], n)
            found[:, k] = total / weight
    return found


def _largest_label(corners: Ints, rows: Ints, owner: Ints, areas: Array, n: int) -> Array:
    labels, code = np.unique(rows, axis=0, return_inverse=True)
    pair, at = np.unique(corners * len(labels) + code.ravel()[owner], return_inverse=True)
    vertex, label = np.divmod(pair, len(labels))
    order = np.lexsort((-label, np.bincount(at, areas), vertex))
    last = order[np.append(np.diff(vertex[order]) > 0, True)]  # of each vertex
    found = np.full((n, rows.shape[1]), np.nan)
    found[vertex[last]] = labels[label[last]]
    return found
