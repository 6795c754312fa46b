"""Normals of a point set from its own neighbourhoods."""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def point_normals(points: Array, neighbours: int = 12) -> Array:
    """Return unoriented unit normals (n, d): the direction of least spread of each point's nearest
    neighbours.
    """
    from scipy.spatial import cKDTree

    _, near = cKDTree(points).query(points, k=min(neighbours, len(points)))
    local = points[near] - points[near].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", local, local))
    return np.ascontiguousarray(vectors[:, :, 0])
