"""How much of what a wall faces is wall again: pictures are a little darker there, so that folds are seen."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from ...arrays import Array
from ...geometry.surface import Surface
from ...parallel import by_rows

PATCHES = 300  # about so many parts of the wall stand for all of it
RECEIVERS = 20_000  # more vertices take their value from the nearest of so many
NEAREST = 4
LEAST = 1000  # vertices that a thread is worth


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
    cells -= cells.min(axis=0)
    key = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    place = np.unique(key, return_inverse=True)[1]
    joined = np.column_stack([areas, areas[:, None] * at, area_vectors])
    sums = np.column_stack([np.bincount(place, column) for column in joined.T]).astype(np.float64)
    return sums[:, 1:4] / np.maximum(sums[:, :1], 1e-300), sums[:, 4:]


def _blocked_share(at: Array, normals: Array, middles: Array, area_vectors: Array) -> Array:
    """Return the share (n,) of what each vertex faces that patches take."""
    found = np.empty(len(at))
    by_rows(_add_patches, LEAST, (at, normals, found), middles, area_vectors)
    return found


@njit(cache=True, nogil=True)
def _add_patches(at, normals, found, middles, area_vectors):  # type: ignore[no-untyped-def]
    for i in range(len(at)):
        x, y, z = at[i, 0], at[i, 1], at[i, 2]
        share = 0.0
        for k in range(len(middles)):
            u, v, w = middles[k, 0] - x, middles[k, 1] - y, middles[k, 2] - z
            faces = normals[i, 0] * u + normals[i, 1] * v + normals[i, 2] * w  # d cos(a)
            a, b, c = area_vectors[k, 0], area_vectors[k, 1], area_vectors[k, 2]
            faced = -(a * u + b * v + c * w)  # A d cos(b)
            if faces > 0.0 and faced > 0.0:
                area = np.sqrt(a * a + b * b + c * c)
                # a vertex may be in the middle of its own patch
                squared = max(u * u + v * v + w * w, 1e-3 * area + 1e-12)
                share += faces * faced / (squared * (np.pi * squared + area))
        found[i] = min(share, 1.0)
