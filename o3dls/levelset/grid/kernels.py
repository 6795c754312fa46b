"""Compiled loops over lattice nodes: arrays in, arrays out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...arrays import ROUNDING, Ints


@njit(cache=True, nogil=True)
def fill_far(rows, keys, phi, width):  # type: ignore[no-untyped-def]
    """Write band values into the rows of a box and carry their sign along each row; the pad makes every row
    start outside.
    """
    length = rows.shape[1]
    at = 0
    for row in range(rows.shape[0]):
        sign = 1.0
        for k in range(length):
            if at < keys.shape[0] and keys[at] == row * length + k:
                value = min(width, max(-width, phi[at]))
                rows[row, k] = value
                sign = -1.0 if value < 0.0 else 1.0
                at += 1
            elif sign < 0.0:
                rows[row, k] = -width


@njit(cache=True, nogil=True)
def rows_of(keys, wanted):  # type: ignore[no-untyped-def]
    """Return the row (n,) of each wanted key among keys, both ascending; -1 where it is not there."""
    rows = np.full(len(wanted), -1, dtype=np.int32)
    at = 0
    for k in range(len(wanted)):
        while at < len(keys) and keys[at] < wanted[k]:
            at += 1
        if at < len(keys) and keys[at] == wanted[k]:
            rows[k] = at
    return rows


@njit(cache=True, nogil=True)
def crossed_cells(neighbours, phi):  # type: ignore[no-untyped-def]
    """Return the corner rows (c, 2^d) of the lattice cells that phi changes sign in (bit a of a corner's
    number: a step along axis a); neighbours (n, d, 2) as a band has them.
    """
    dimension = neighbours.shape[1]
    wide = 1 << dimension
    corners = np.empty(wide, dtype=np.int64)
    cells = np.empty((0, wide), dtype=np.int64)
    for filling in range(2):  # count, then fill
        count = 0
        for first in range(len(phi)):
            corners[0] = first
            inside = 1 if phi[first] < 0.0 else 0
            whole = True
            for axis in range(dimension):
                for c in range(1 << axis):
                    row = neighbours[corners[c], axis, 1]
                    whole = whole and row >= 0
                    corners[(1 << axis) + c] = max(row, 0)
                    inside += 1 if phi[max(row, 0)] < 0.0 else 0
            if whole and 0 < inside < wide:
                if filling == 1:
                    cells[count] = corners
                count += 1
        if filling == 0:
            cells = np.empty((count, wide), dtype=np.int64)
    return cells


@njit(cache=True, nogil=True)
def march_simplices(corners, phi, simplices):  # type: ignore[no-untyped-def]
    """Return the linear zero set of phi on simplices that split each lattice cell (Kuhn), manifold by
    construction.

    corners (c, 2**d) rows of the cells' corners (bit a of the corner number = step along axis a), simplices
    (s, d+1) corner numbers along rising paths. Returns faces (m, d) of edge keys (row * 2**d + direction)
    and, per face, the cell and simplex it came from, (m, 2).
    """
    size = simplices.shape[1]
    count = 0
    wide = corners.shape[1]
    faces = np.empty((0, size - 1), dtype=np.int64)
    source = np.empty((0, 2), dtype=np.int64)
    inside, outside = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    cut = np.empty(4, dtype=np.int64)
    for filling in range(2):  # count, then fill
        if filling == 1:
            faces = np.empty((count, size - 1), dtype=np.int64)
            source = np.empty((count, 2), dtype=np.int64)
        count = 0
        for c in range(corners.shape[0]):
            for s in range(simplices.shape[0]):
                n_in = n_out = 0
                for v in range(size):
                    corner = simplices[s, v]
                    if phi[corners[c, corner]] < 0.0:
                        inside[n_in] = corner
                        n_in += 1
                    else:
                        outside[n_out] = corner
                        n_out += 1
                if n_in == 0 or n_out == 0:
                    continue
                made = 2 if n_in == 2 and n_out == 2 else 1
                if filling == 1:
                    k = 0
                    for a in range(n_in):  # the four corners of a quadrilateral, in their order around it
                        for b in range(n_out):
                            u = inside[a]
                            v = outside[b if a == 0 else n_out - 1 - b]
                            # along a rising path the smaller number comes first
                            cut[k] = corners[c, min(u, v)] * wide + (u ^ v)
                            k += 1
                    for f in range(made):
                        for v in range(size - 1):
                            faces[count + f, v] = cut[v if f == 0 or v == 0 else v + 1]
                        source[count + f, 0], source[count + f, 1] = c, s
                count += made
    return faces, source


class Origin(NamedTuple):
    """This says which cell and which simplex of it each face is in: `source` (m, 2) into the corners of cells
    (c, 2^d), and into the numbers of those corners that are a simplex (s, d + 1).
    """

    cells: Ints
    simplices: Ints
    source: Ints


@njit(cache=True, nogil=True)
def wind_outward(faces, vertices, positions, phi, origin):  # type: ignore[no-untyped-def]
    """Turn (in place) every face of `march_simplices` so that its normal points to where phi is positive in
    its simplex: from the mean inner to the mean outer corner.
    """
    cells, simplices, source = origin
    size = faces.shape[1]
    means, count = np.zeros((2, size)), np.zeros(2)
    for m in range(faces.shape[0]):
        means[:], count[:] = 0.0, 0.0
        for k in range(size + 1):
            row = cells[source[m, 0], simplices[source[m, 1], k]]
            side = 0 if phi[row] < 0.0 else 1
            count[side] += 1.0
            for a in range(size):
                means[side, a] += (positions[row, a] - means[side, a]) / count[side]
        first, last = faces[m, 0], faces[m, size - 1]
        along = 0.0
        for a in range(size):
            b, c = (a + 1) % size, (a + 2) % size
            if size == 2:
                normal = (1 - 2 * a) * (vertices[last, b] - vertices[first, b])
            else:
                normal = _edge_component(vertices, faces[m], 1, b) * _edge_component(vertices, faces[m], 2, c)
                normal -= _edge_component(vertices, faces[m], 1, c) * _edge_component(
                    vertices, faces[m], 2, b
                )
            along += normal * (means[1, a] - means[0, a])
        if along < 0.0:
            faces[m, 0], faces[m, size - 1] = last, first


@njit(cache=True, inline="always")
def _edge_component(vertices, face, corner, axis):  # type: ignore[no-untyped-def]
    """Return the component along an axis of the edge from the first corner of a face to another."""
    return vertices[face[corner], axis] - vertices[face[0], axis]


@njit(cache=True, nogil=True)
def curvature(phi, neighbours, spacing):  # type: ignore[no-untyped-def]
    """Return div(grad phi / |grad phi|) per node by central differences; phi is continued evenly where the
    band ends.
    """
    n, dim = neighbours.shape[0], neighbours.shape[1]
    out = np.zeros(n)
    first = np.empty(dim)
    second = np.empty((dim, dim))
    for i in range(n):
        norm2 = 0.0
        for a in range(dim):
            lo, hi = _or_self(neighbours[i, a, 0], i), _or_self(neighbours[i, a, 1], i)
            first[a] = (phi[hi] - phi[lo]) / (2.0 * spacing)
            second[a, a] = (phi[hi] - 2.0 * phi[i] + phi[lo]) / spacing**2
            norm2 += first[a] ** 2
            for b in range(a):
                mixed = 0.0
                for sign_a in range(2):
                    j = _or_self(neighbours[i, a, sign_a], i)
                    for sign_b in range(2):
                        k = _or_self(neighbours[j, b, sign_b], j)
                        mixed += phi[k] if sign_a == sign_b else -phi[k]
                second[a, b] = second[b, a] = mixed / (4.0 * spacing**2)
        if norm2 < ROUNDING:
            continue
        for a in range(dim):
            out[i] += second[a, a] * norm2
            for b in range(dim):
                out[i] -= first[a] * first[b] * second[a, b]
        out[i] /= norm2**1.5
    return out


@njit(cache=True, inline="always")
def _or_self(neighbour, own):  # type: ignore[no-untyped-def]
    return neighbour if neighbour >= 0 else own
