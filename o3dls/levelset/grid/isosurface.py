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
    """Return the surface phi = 0 as vertices (v, d) and faces (m, d) wound outward: closed, manifold, exact
    for a linear phi.

    The band must reach a cell beyond the surface. Lattice cells are split into simplices, so no case is
    ambiguous.
    """
    cells = kernels.crossed_cells(band.neighbours, phi)
    simplices = _cube_simplices(band.dimension)
    if len(cells) == 0:
        return np.zeros((0, band.dimension)), np.zeros((0, band.dimension), dtype=np.int64)
    least = LEAST_STEP * band.spacing  # a vertex at a node would make faces without area
    safe = np.where(np.abs(phi) < least, np.where(phi < 0.0, -least, least), phi)
    keyed, source = kernels.march_simplices(cells, safe, simplices)
    used = np.zeros(len(band) << band.dimension, dtype=bool)
    used[keyed] = True
    tail, step = np.divmod(np.flatnonzero(used), 2**band.dimension)
    head = tail
    for axis in range(band.dimension):
        head = np.where(step >> axis & 1, band.neighbours[head, axis, 1], head)
    share = safe[tail] / (safe[tail] - safe[head])
    vertices = band.positions[tail] + share[:, None] * (band.positions[head] - band.positions[tail])
    faces = (np.cumsum(used) - 1)[keyed]
    origin = kernels.Origin(cells, simplices, source)
    kernels.wind_outward(faces, vertices, band.positions, safe, origin)
    return vertices, faces


def _cube_simplices(dimension: int) -> Ints:
    """Return the d! simplices of a cube as rising paths of corner numbers from 0 to 2^d - 1 (Kuhn 1960)."""
    return np.array(
        [np.cumsum([0, *(1 << axis for axis in path)]) for path in permutations(range(dimension))]
    )


def reinitialise(band: Band, phi: Array, width: float | None = None) -> SignedDistance:
    """Return the exact signed distance of the zero set of phi, on the band around where that set now is:
    |grad phi| = 1 again. width: of the new band, by default that of the old.
    """
    vertices, faces = zero_set(band, phi)
    return signed_distance(vertices, faces, band.spacing, band.width if width is None else width)
