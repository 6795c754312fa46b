"""Inside or outside by winding numbers along lattice rows: exact for closed surfaces, also where they overlap
themselves.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def winding(nodes, vertices, faces, shape):  # type: ignore[no-untyped-def]
    """Return the winding number (n,) of a closed surface around lattice nodes in C order, and the rows
    (count) whose crossings do not cancel.

    Along each row of the last real axis the faces crossed so far are summed with their orientation: exact,
    also where the surface overlaps itself. Edges that meet a row are given to one side by an infinitesimal
    shift of the row, the same for both neighbours. vertices (v, 3) in lattice units, faces (m, 3) or (m, 2);
    a 2D box has shape (nx, ny, 1) and rows along y.
    """
    flat = faces.shape[1] == 2
    rows = shape[0] if flat else shape[0] * shape[1]
    start = np.zeros(rows + 1, dtype=np.int64)
    height = np.empty(0)
    turn = np.empty(0, dtype=np.int8)
    for filling in range(2):  # count, then fill
        if filling == 1:
            for row in range(rows):
                start[row + 1] += start[row]
            height = np.empty(start[rows])
            turn = np.empty(start[rows], dtype=np.int8)
        cursor = start.copy()
        for m in range(faces.shape[0]):
            ids = faces[m]
            low_i, high_i = _row_range(vertices, ids, 0, shape[0])
            low_j, high_j = (0, 0) if flat else _row_range(vertices, ids, 1, shape[1])
            for i in range(low_i, high_i + 1):
                for j in range(low_j, high_j + 1):
                    sign, z = (
                        _cross_segment(vertices, ids, i) if flat else _cross_triangle(vertices, ids, i, j)
                    )
                    if sign != 0:
                        row = i if flat else i * shape[1] + j
                        if filling == 0:
                            start[row + 1] += 1
                        else:
                            height[cursor[row]], turn[cursor[row]] = z, sign
                            cursor[row] += 1
    open_rows = 0
    for row in range(rows):
        total = 0
        for c in range(start[row], start[row + 1]):
            total += turn[c]
        open_rows += total != 0
    number = np.zeros(nodes.shape[0], dtype=np.int32)
    for n in range(nodes.shape[0]):
        row = nodes[n, 0] if flat else nodes[n, 0] * shape[1] + nodes[n, 1]
        z = nodes[n, 1] if flat else nodes[n, 2]
        for c in range(start[row], start[row + 1]):
            if height[c] < z:
                number[n] += turn[c]
    return number, open_rows


@njit(cache=True, nogil=True)
def _row_range(vertices, ids, axis, size):  # type: ignore[no-untyped-def]
    low = high = vertices[ids[0], axis]
    for c in range(1, ids.shape[0]):
        low, high = min(low, vertices[ids[c], axis]), max(high, vertices[ids[c], axis])
    return max(0, int(np.ceil(low))), min(size - 1, int(np.floor(high)))


@njit(cache=True, nogil=True)
def _side_of_edge(vertices, u, v, x, y):  # type: ignore[no-untyped-def]
    """Return the side (+1 left, -1 right) of the directed edge u -> v that the node (x, y) lies on, never 0.

    The edge is always evaluated from its lower to its higher vertex, so that its two faces see the same
    number; on the edge the node is shifted by (e, e^2).
    """
    flip = 1
    if u > v:
        u, v, flip = v, u, -1
    dx, dy = vertices[v, 0] - vertices[u, 0], vertices[v, 1] - vertices[u, 1]
    value = dx * (y - vertices[u, 1]) - dy * (x - vertices[u, 0])
    if value == 0.0:
        value = -dy if dy != 0.0 else dx
    return flip if value > 0.0 else -flip


@njit(cache=True, nogil=True)
def _cross_triangle(vertices, ids, x, y):  # type: ignore[no-untyped-def]
    """Say whether the vertical line through (x, y) crosses the triangle: -1 upward out of it, +1 into it, 0
    no; and the height.
    """
    a, b, c = ids[0], ids[1], ids[2]
    side = _side_of_edge(vertices, a, b, x, y)
    if side != _side_of_edge(vertices, b, c, x, y) or side != _side_of_edge(vertices, c, a, x, y):
        return 0, 0.0
    ux, uy, uz = (
        vertices[b, 0] - vertices[a, 0],
        vertices[b, 1] - vertices[a, 1],
        vertices[b, 2] - vertices[a, 2],
    )
    wx, wy, wz = (
        vertices[c, 0] - vertices[a, 0],
        vertices[c, 1] - vertices[a, 1],
        vertices[c, 2] - vertices[a, 2],
    )
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    z = vertices[a, 2]
    if nz != 0.0:
        z -= (nx * (x - vertices[a, 0]) + ny * (y - vertices[a, 1])) / nz
    return -side, z  # counter-clockwise from above: the normal points up, the line leaves


@njit(cache=True, nogil=True)
def _cross_segment(vertices, ids, x):  # type: ignore[no-untyped-def]
    """Say as `_cross_triangle` does whether the vertical line through x crosses a segment; a vertex on the
    line belongs to the side of larger x.
    """
    a, b = ids[0], ids[1]
    xa, xb = vertices[a, 0], vertices[b, 0]
    if (xa <= x) == (xb <= x):
        return 0, 0.0
    t = (x - xa) / (xb - xa)
    return (1 if xa < xb else -1), vertices[a, 1] + t * (vertices[b, 1] - vertices[a, 1])
