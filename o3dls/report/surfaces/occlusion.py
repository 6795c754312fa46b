"""How much of what a wall faces is wall again: pictures are a little darker there, so that folds are seen."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Array
from ...geometry.surface import Surface

PATCHES = 300  # about so many parts of the wall stand for all of it
RECEIVERS = 5000  # more vertices take their value from the nearest of so many
NEAREST = 4


def occlusion(surface: Surface) -> Array:
    """Return for each vertex (n,) which share of the light from outside the rest of the wall keeps from it,
    within 0 (none, as everywhere on a ball) and 1.

    Each patch of the wall, of area A at the distance d, takes A cos(a) cos(b) / (pi d^2 + A), with the angles
    of the line between the two to the normal of each (the view factor of a disc). A patch behind another
    counts too.
    """
    at, normals = surface.vertices - surface.vertices.mean(axis=0), surface.vertex_normals
    step = -(-len(at) // RECEIVERS)
    found = _blocked_share(
        at[::step], normals[::step], *_patches(at, normals * surface.vertex_areas[:, None])
    )
    if step == 1:
        return found
    distance, nearest = map(np.asarray, cKDTree(at[::step]).query(at, k=NEAREST))
    weights = 1.0 / (distance + 1e-6)
    return np.asarray((weights * found[nearest]).sum(axis=1) / weights.sum(axis=1))


def _patches(at: Array, area_vectors: Array) -> tuple[Array, Array]:
    """Join vertices (n, 3) that share a cell and a direction, and return middles and area vectors (k, 3)."""
    areas = np.linalg.norm(area_vectors, axis=1)
    side = np.sqrt(areas.sum() / PATCHES)
    cells = np.column_stack([np.floor(at / side), area_vectors > 0]).astype(np.int64)
    place = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
    joined = np.column_stack([areas, areas[:, None] * at, area_vectors])
    sums = np.column_stack([np.bincount(place, column) for column in joined.T]).astype(np.float64)
    return sums[:, 1:4] / np.maximum(sums[:, :1], 1e-300), sums[:, 4:]


def _blocked_share(at: Array, normals: Array, middles: Array, area_vectors: Array) -> Array:
    """Return the share (n,) of what each vertex faces that patches take, in single precision."""
    p, n, c, a = (part.astype(np.float32) for part in (at, normals, middles, area_vectors))
    faces = n @ c.T - (p * n).sum(axis=1)[:, None]  # d cos(a)
    faced = p @ a.T - (c * a).sum(axis=1)  # A d cos(b)
    squared = (p**2).sum(axis=1)[:, None] + (c**2).sum(axis=1) - 2 * p @ c.T
    areas = np.linalg.norm(a, axis=1)
    np.maximum(squared, 1e-3 * areas + 1e-12, out=squared)  # a vertex in the middle of its own patch
    seen = np.maximum(faces, 0, out=faces)
    seen *= np.maximum(faced, 0, out=faced)
    seen /= squared * (np.float32(np.pi) * squared + areas)
    return np.asarray(np.minimum(seen.sum(axis=1), 1.0), dtype=np.float64)
