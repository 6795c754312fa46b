"""Differential operators on a narrow band, the regularised delta and Heaviside functions, and the zero set as simplices."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..geometry import Array, Ints, Surface, used_by
from . import kernels
from .distance import SignedDistance, signed_distance
from .grid import Band

CRUMB = 0.01  # area of a piece over that of the largest: no vein, appendage or chamber is so small


def gradient(band: Band, phi: Array) -> Array:
    """Central differences (n, d); one-sided where the band ends."""
    own = np.arange(len(band))[:, None]
    low, high = (np.where(band.neighbours[:, :, k] >= 0, band.neighbours[:, :, k], own) for k in (0, 1))
    steps = np.maximum((low != own).astype(int) + (high != own), 1)
    return np.asarray((phi[high] - phi[low]) / (steps * band.spacing))


def mean_curvature(band: Band, phi: Array) -> Array:
    """div(grad phi / |grad phi|), (n,): sum of the principal curvatures of the level sets, positive on a sphere."""
    return np.asarray(kernels.curvature(phi, band.neighbours, band.spacing))


def laplacian(band: Band) -> sparse.csr_matrix:
    """Minus the Laplacian on the band with no flow through its border: symmetric, positive semidefinite, (n, n), in 1/length^2."""
    rows, axes, sides = np.nonzero(band.neighbours >= 0)
    weights = np.full(len(rows), 1.0 / band.spacing**2)
    links = sparse.csr_matrix((weights, (rows, band.neighbours[rows, axes, sides])), shape=(len(band), len(band)))
    return sparse.csr_matrix(sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links)


def delta(phi: Array, reach: float) -> Array:
    """Regularised Dirac function, 0 beyond |phi| = reach, integral 1."""
    return np.asarray(np.where(np.abs(phi) < reach, (1.0 + np.cos(np.pi * phi / reach)) / (2.0 * reach), 0.0))


def heaviside(phi: Array, reach: float) -> Array:
    """Its integral: 0 inside (phi < -reach), 1 outside."""
    s = np.clip(phi / reach, -1.0, 1.0)
    return np.asarray(0.5 * (1.0 + s + np.sin(np.pi * s) / np.pi))


def zero_set(band: Band, phi: Array) -> tuple[Array, Ints]:
    """The surface phi = 0 as vertices (v, d) and faces (m, d) wound outward: closed, manifold, exact for a linear phi.

    The band must reach a cell beyond the surface. Lattice cells are split into simplices, so no case is ambiguous.
    """
    cells, simplices = _cells(band, phi), _simplices(band.dimension)
    if len(cells) == 0:
        return np.zeros((0, band.dimension)), np.zeros((0, band.dimension), dtype=np.int64)
    least = 1e-6 * band.spacing  # a vertex at a node would make faces without area
    safe = np.where(np.abs(phi) < least, np.where(phi < 0.0, -least, least), phi)
    keyed, source = kernels.march_simplices(cells, safe, simplices)
    keys, faces = np.unique(keyed, return_inverse=True)
    tail, step = np.divmod(keys, 2**band.dimension)
    head = band.find(band.nodes[tail] + (step[:, None] >> np.arange(band.dimension) & 1))
    share = safe[tail] / (safe[tail] - safe[head])
    vertices = band.positions[tail] + share[:, None] * (band.positions[head] - band.positions[tail])
    return vertices, _outward(vertices, faces.reshape(keyed.shape), band, safe, cells[source[:, 0]], simplices[source[:, 1]])


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
    return np.ascontiguousarray(corners[(corners >= 0).all(axis=1) & (inside > 0) & (inside < 2**band.dimension)], dtype=np.int64)


def _simplices(dimension: int) -> Ints:
    """The d! simplices of a cube as rising paths of corner numbers from 0 to 2^d - 1 (Kuhn 1960)."""
    return np.array([np.cumsum([0, *(1 << axis for axis in path)]) for path in permutations(range(dimension))])


def _outward(vertices: Array, faces: Ints, band: Band, phi: Array, cells: Ints, simplices: Ints) -> Ints:
    """Turn every face so that its normal points to where phi is positive in its simplex."""
    rows = np.take_along_axis(cells, simplices, axis=1)
    outside = phi[rows] >= 0.0
    share = np.where(outside, 1.0 / outside.sum(axis=1, keepdims=True), -1.0 / (~outside).sum(axis=1, keepdims=True))
    away = np.einsum("mv,mvd->md", share, band.positions[rows])  # from the mean inner to the mean outer corner
    edge = vertices[faces[:, 1]] - vertices[faces[:, 0]]
    if band.dimension == 2:
        normal = np.column_stack([edge[:, 1], -edge[:, 0]])
    else:
        normal = np.cross(edge, vertices[faces[:, 2]] - vertices[faces[:, 0]])
    wrong = (normal * away).sum(axis=1) < 0.0
    return np.asarray(np.where(wrong[:, None], faces[:, ::-1], faces))


def reinitialise(band: Band, phi: Array) -> SignedDistance:
    """The exact signed distance of the zero set of phi, on the band around where that set now is: |grad phi| = 1 again."""
    vertices, faces = zero_set(band, phi)
    return signed_distance(vertices, faces, band.spacing, band.width)


def combine(first: SignedDistance, second: SignedDistance, *, remove: bool) -> tuple[Band, Array]:
    """The union of two insides with a fillet, or the first without the second (`remove`), on the nodes around the new surface.

    Both on one lattice; the result has the right sign everywhere and is a distance near either surface. Works on the full box: a change
    of topology is rare.
    """
    a, b = first.band, second.band
    low = np.minimum(a.low, b.low)
    shape = np.maximum(a.low + a.shape, b.low + b.shape) - low
    boxes = [np.full(shape, np.float32(f.band.width)) for f in (first, second)]
    for box, f in zip(boxes, (first, second), strict=True):
        start = f.band.low - low
        box[tuple(slice(s, s + n) for s, n in zip(start, f.band.shape, strict=True))] = f.band.dense(f.phi)
    mixed = np.maximum(boxes[0], -boxes[1]) if remove else _filleted(boxes[0], boxes[1], a.width)
    nodes = np.argwhere(np.abs(mixed) < a.width)
    band = Band(a.spacing, a.width, low, tuple(int(n) for n in shape), np.ascontiguousarray(nodes, dtype=np.int32))
    return band, mixed[tuple(nodes.T)].astype(np.float64)


def _filleted(a: NDArray[np.float32], b: NDArray[np.float32], width: float) -> NDArray[np.float32]:
    """The smaller of two level sets, rounded where they differ by less than `width`: vessels leave a chamber without a sharp crease."""
    near = np.maximum(1.0 - np.abs(a - b) / width, 0.0)
    return np.asarray(np.minimum(a, b) - 0.25 * width * near**2, dtype=np.float32)


def linked(band: Band, chosen: NDArray[np.bool_]) -> Ints:
    """Connected pieces (n,) of the chosen nodes, numbered from 0 by falling size; -1 elsewhere."""
    rows, axes, sides = np.nonzero(band.neighbours >= 0)
    other = band.neighbours[rows, axes, sides]
    both = chosen[rows] & chosen[other]
    links = sparse.csr_matrix((np.ones(both.sum()), (rows[both], other[both])), shape=(len(band), len(band)))
    _, own, size = np.unique(connected_components(links, directed=False)[1][chosen], return_inverse=True, return_counts=True)
    rank = np.empty(len(size), dtype=np.int64)
    rank[np.argsort(-size, kind="stable")] = np.arange(len(size))
    named = np.full(len(band), -1)
    named[chosen] = rank[own]
    return named


def without_shreds(band: Band, phi: Array) -> Array:
    """The level set with its largest inside and its largest outside alone: islands and cavities change their side."""
    whole = phi.copy()
    for side in (-1.0, 1.0):
        chosen = side * whole > 0.0
        whole[linked(band, chosen) > 0] *= -1.0
    return whole


def pieces(count: int, faces: Ints) -> Ints:
    """Number (count,) of the connected piece that each of `count` vertices belongs to."""
    ends = np.roll(faces, -1, axis=1)
    links = sparse.csr_matrix((np.ones(faces.size), (faces.ravel(), ends.ravel())), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def topology(vertices: Array, faces: Ints) -> tuple[int, int]:
    """Pieces and Euler number of a closed surface (2 per piece without handles in 3D, 0 in 2D)."""
    used, renumbered = used_by(len(vertices), faces)
    count, n = int(pieces(int(used.sum()), renumbered).max(initial=-1)) + 1, int(used.sum())
    return count, n - (len(faces) // 2 if faces.shape[1] == 3 else len(faces))  # a triangle has half of three edges


def piece_areas(surface: Surface) -> tuple[Ints, Array]:
    """Number (m,) of the connected piece that each face is of, and the areas (k,) of the pieces."""
    _, piece = np.unique(pieces(len(surface.vertices), surface.faces)[surface.faces[:, 0]], return_inverse=True)
    return np.asarray(piece, dtype=np.int64), np.asarray(np.bincount(piece, surface.face_areas), dtype=np.float64)


def largest_piece(vertices: Array, faces: Ints) -> tuple[Array, Ints]:
    """The connected piece of a closed surface that encloses most, without the vertices of the others."""
    label = pieces(len(vertices), faces)
    corners = vertices[faces] - vertices.mean(axis=0)
    piece = np.bincount(label[faces[:, 0]], weights=np.linalg.det(corners))
    kept = faces[label[faces[:, 0]] == piece.argmax()]
    used, renumbered = used_by(len(vertices), kept)
    return vertices[used], renumbered
