"""The zero set of a level set as simplices: closed, manifold, exact for a linear phi."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from ...arrays import Array, Ints
from . import kernels
from .band import Band
from .distance import SignedDistance, signed_distance

LEAST_STEP = 1e-6  # spacings: of a vertex from a node


def zero_set(band: Band, phi: Array) -> tuple[Array, Ints]:
    """The surface phi = 0 as vertices (v, d) and faces (m, d) wound outward: closed, manifold, exact for a
    linear phi.

    The band must reach a cell beyond the surface. Lattice cells are split into simplices, so no case is
    ambiguous.
    """
    cells = _cells(band, phi)
    simplices = _simplices(band.dimension)
    if len(cells) == 0:
        return np.zeros((0, band.dimension)), np.zeros((0, band.dimension), dtype=np.int64)
    least = LEAST_STEP * band.spacing  # a vertex at a node would make faces without area
    safe = np.where(np.abs(phi) < least, np.where(phi < 0.0, -least, least), phi)
    keyed, source = kernels.march_simplices(cells, safe, simplices)
    keys, faces = np.unique(keyed, return_inverse=True)
    tail, step = np.divmod(keys, 2**band.dimension)
    head = band.find(band.nodes[tail] + (step[:, None] >> np.arange(band.dimension) & 1))
    share = safe[tail] / (safe[tail] - safe[head])
    vertices = band.positions[tail] + share[:, None] * (band.positions[head] - band.positions[tail])
    return vertices, _outward(
        vertices, faces.reshape(keyed.shape), band, safe, cells[source[:, 0]], simplices[source[:, 1]]
    )


def _cells(band: Band, phi: Array) -> Ints:
    """Corner rows (c, 2^d) of the lattice cells that phi changes sign in."""
    columns = []
    for corner in range(2**band.dimension):  # bit a of its number: a step along axis a
        row = np.arange(len(band))
        for axis in range(band.dimension):
            if corner >> axis & 1:
                row = np.where(row >= 0, band.neighbours[row, axis, 1], -1)
        columns.append(row)
    corners = np.column_stack(columns)
    inside = (phi[corners] < 0.0).sum(axis=1)
    return np.ascontiguousarray(
        corners[(corners >= 0).all(axis=1) & (inside > 0) & (inside < 2**band.dimension)], dtype=np.int64
    )


def _simplices(dimension: int) -> Ints:
    """The d! simplices of a cube as rising paths of corner numbers from 0 to 2^d - 1 (Kuhn 1960)."""
    return np.array(
        [np.cumsum([0, *(1 << axis for axis in path)]) for path in permutations(range(dimension))]
    )


def _outward(vertices: Array, faces: Ints, band: Band, phi: Array, cells: Ints, simplices: Ints) -> Ints:
    """Turn every face so that its normal points to where phi is positive in its simplex."""
    rows = np.take_along_axis(cells, simplices, axis=1)
    outside = phi[rows] >= 0.0
    share = np.where(
        outside, 1.0 / outside.sum(axis=1, keepdims=True), -1.0 / (~outside).sum(axis=1, keepdims=True)
    )
    # from the mean inner to the mean outer corner
    away = np.einsum("mv,mvd->md", share, band.positions[rows])
    edge = vertices[faces[:, 1]] - vertices[faces[:, 0]]
    if band.dimension == 2:
        normal = np.column_stack([edge[:, 1], -edge[:, 0]])
    else:
        normal = np.cross(edge, vertices[faces[:, 2]] - vertices[faces[:, 0]])
    wrong = (normal * away).sum(axis=1) < 0.0
    return np.asarray(np.where(wrong[:, None], faces[:, ::-1], faces))


def reinitialise(band: Band, phi: Array, width: float | None = None) -> SignedDistance:
    """The exact signed distance of the zero set of phi, on the band around where that set now is: |grad phi|
    = 1 again. width: of the new band, by default that of the old.
    """
    vertices, faces = zero_set(band, phi)
    return signed_distance(vertices, faces, band.spacing, band.width if width is None else width)
