"""Compiled loops over triangles (3D) or segments (2D) and lattice nodes: arrays in, arrays out; 2D boxes have a third axis of length 1."""

from __future__ import annotations

import numpy as np
from numba import njit

from .closest import _on_segment, _on_triangle


@njit(cache=True)
def fill_far(rows, keys, phi, width):  # type: ignore[no-untyped-def]
    """Write band values into the rows of a box and carry their sign along each row; the pad makes every row start outside."""
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


@njit(cache=True)
def touched_blocks(corners, reach, shape, bits):  # type: ignore[no-untyped-def]
    """Number the blocks of 2**bits nodes that a face's box, grown by `reach` nodes, can touch; -1 elsewhere.

    corners (m, c, 3) in lattice units. Returns the table (blocks per axis) and the count.
    """
    table = np.full((shape[0] + 7 >> 3, shape[1] + 7 >> 3, (shape[2] + (1 << bits) - 1) >> bits), -1, dtype=np.int32)
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for m in range(corners.shape[0]):
        _face_box(corners[m], reach, shape, first, last)
        for i in range(first[0] >> 3, (last[0] >> 3) + 1):
            for j in range(first[1] >> 3, (last[1] >> 3) + 1):
                for k in range(first[2] >> bits, (last[2] >> bits) + 1):
                    table[i, j, k] = 0
    count = 0
    for i in range(table.shape[0]):
        for j in range(table.shape[1]):
            for k in range(table.shape[2]):
                if table[i, j, k] == 0:
                    table[i, j, k] = count
                    count += 1
    return table, count


@njit(cache=True)
def _face_box(face, reach, shape, first, last):  # type: ignore[no-untyped-def]
    """First and last node per axis of a face's box grown by `reach`, clipped to the lattice."""
    for a in range(3):
        low = high = face[0, a]
        for c in range(1, face.shape[0]):
            low, high = min(low, face[c, a]), max(high, face[c, a])
        first[a] = max(0, int(np.ceil(low - reach)))
        last[a] = min(shape[a] - 1, int(np.floor(high + reach)))


@njit(cache=True)
def scatter_distance(corners, reach, shape, bits, table, count):  # type: ignore[no-untyped-def]
    """Smallest squared distance (lattice units) of the nodes within `reach` to any face, and that face, per block.

    A face looks along the rows of its grown box, only where its plane and its bounding sphere are within reach; most of these nodes are
    turned away by a bound that their best face so far already beats.
    """
    best = np.full((count, 64 << bits), np.float32(np.inf), dtype=np.float32)
    owner = np.full((count, 64 << bits), -1, dtype=np.int32)
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    shape_of = np.empty(13)
    mask = (1 << bits) - 1
    flat = corners.shape[1] == 2
    for m in range(corners.shape[0]):
        face = corners[m]
        _face_box(face, reach, shape, first, last)
        _measure(face, shape_of)
        cx, cy, cz, radius, nx, ny, nz = shape_of[:7]
        ax, ay, az = face[0]
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                aside2 = (i - cx) ** 2 + (j - cy) ** 2
                room = (reach + radius) ** 2 - aside2
                if room < 0.0:
                    continue
                half = np.sqrt(room)
                low, high = max(first[2], int(np.ceil(cz - half))), min(last[2], int(np.floor(cz + half)))
                tilt = (i - ax) * nx + (j - ay) * ny
                if abs(nz) > 1e-3:
                    up, down = az + (reach - tilt) / nz, az - (reach + tilt) / nz
                    low, high = max(low, int(np.ceil(min(up, down) - 1e-9))), min(high, int(np.floor(max(up, down) + 1e-9)))
                row = ((i & 7) << 3 | (j & 7)) << bits
                for k in range(low, high + 1):
                    block = table[i >> 3, j >> 3, k >> bits]
                    limit = min(np.float64(best[block, row | (k & mask)]), reach * reach)
                    away = tilt + (k - az) * nz
                    if away * away > limit:
                        continue
                    excess = np.sqrt(aside2 + (k - cz) ** 2) - radius
                    if excess > 0.0 and excess * excess > limit:
                        continue
                    x, y, z = i - ax, j - ay, k - az
                    gap2 = _segment_gap2(x, y, shape_of) if flat else _triangle_gap2(x, y, z, away, shape_of)
                    if gap2 <= limit:
                        best[block, row | (k & mask)] = gap2
                        owner[block, row | (k & mask)] = m
    return best, owner


@njit(cache=True)
def _measure(face, out):  # type: ignore[no-untyped-def]
    """Centre (3), radius, unit normal (3; zero where there is no area), edges ab (3) and ac (3) of a face."""
    corners = face.shape[0]
    for a in range(3):
        out[a] = 0.0
        for c in range(corners):
            out[a] += face[c, a] / corners
        out[7 + a], out[10 + a] = face[1, a] - face[0, a], face[corners - 1, a] - face[0, a]
    radius2 = 0.0
    for c in range(corners):
        radius2 = max(radius2, (face[c, 0] - out[0]) ** 2 + (face[c, 1] - out[1]) ** 2 + (face[c, 2] - out[2]) ** 2)
    out[3] = np.sqrt(radius2) * (1.0 + 1e-9) + 1e-6  # float32 distances may be this much too short
    ux, uy, uz, vx, vy, vz = out[7], out[8], out[9], out[10], out[11], out[12]
    x, y, z = (uy, -ux, 0.0) if corners == 2 else (uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)
    length = np.sqrt(x * x + y * y + z * z)
    shrink = 1.0 / length if length > 1e-12 * radius2 and length > 0.0 else 0.0
    out[4], out[5], out[6] = x * shrink, y * shrink, z * shrink


@njit(cache=True, inline="always")
def _segment_gap2(x, y, face):  # type: ignore[no-untyped-def]
    """Squared distance from a point, given from corner a, to a segment."""
    along, length2 = x * face[7] + y * face[8], face[7] ** 2 + face[8] ** 2
    t = min(1.0, max(0.0, along / length2)) if length2 > 0.0 else 0.0
    return (x - t * face[7]) ** 2 + (y - t * face[8]) ** 2


@njit(cache=True, inline="always")
def _triangle_gap2(x, y, z, away, face):  # type: ignore[no-untyped-def]
    """Squared distance from a point, given from corner a, to a triangle: `away`^2 above its inside, else the nearest edge's."""
    ux, uy, uz, vx, vy, vz = face[7], face[8], face[9], face[10], face[11], face[12]
    pu, pv = x * ux + y * uy + z * uz, x * vx + y * vy + z * vz
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    area2 = uu * vv - uv * uv
    s, t = vv * pu - uv * pv, uu * pv - uv * pu
    if s > 0.0 and t > 0.0 and s + t < area2:
        return away * away
    best = np.inf
    for edge in range(3):
        if edge == 0:
            ex, ey, ez, qx, qy, qz = ux, uy, uz, x, y, z
        elif edge == 1:
            ex, ey, ez, qx, qy, qz = vx, vy, vz, x, y, z
        else:
            ex, ey, ez, qx, qy, qz = vx - ux, vy - uy, vz - uz, x - ux, y - uy, z - uz
        length2 = ex * ex + ey * ey + ez * ez
        r = min(1.0, max(0.0, (qx * ex + qy * ey + qz * ez) / length2)) if length2 > 0.0 else 0.0
        best = min(best, (qx - r * ex) ** 2 + (qy - r * ey) ** 2 + (qz - r * ez) ** 2)
    return best


@njit(cache=True)
def gather_band(table, bits, shape, best, owner):  # type: ignore[no-untyped-def]
    """Nodes that have an owner, in C order: indices (n, 3), distance (n,), face (n,)."""
    n = (owner >= 0).sum()
    nodes = np.empty((n, 3), dtype=np.int32)
    gap, face = np.empty(n), np.empty(n, dtype=np.int32)
    at = 0
    for i in range(shape[0]):
        for j in range(shape[1]):
            row = ((i & 7) << 3 | (j & 7)) << bits
            for bk in range(table.shape[2]):
                block = table[i >> 3, j >> 3, bk]
                for c in range(1 << bits if block >= 0 else 0):
                    if owner[block, row + c] >= 0:
                        nodes[at, 0], nodes[at, 1], nodes[at, 2] = i, j, (bk << bits) + c
                        gap[at], face[at] = np.sqrt(best[block, row + c]), owner[block, row + c]
                        at += 1
    return nodes, gap, face


@njit(cache=True)
def winding(nodes, vertices, faces, shape):  # type: ignore[no-untyped-def]
    """Winding number (n,) of a closed surface around lattice nodes in C order, and the rows (count) whose crossings do not cancel.

    Along each row of the last real axis the faces crossed so far are summed with their orientation: exact, also where the surface
    overlaps itself. Edges that meet a row are given to one side by an infinitesimal shift of the row, the same for both neighbours.
    vertices (v, 3) in lattice units, faces (m, 3) or (m, 2); a 2D box has shape (nx, ny, 1) and rows along y.
    """
    flat = faces.shape[1] == 2
    rows = shape[0] if flat else shape[0] * shape[1]
    start = np.zeros(rows + 1, dtype=np.int64)
    height, turn = np.empty(0), np.empty(0, dtype=np.int8)
    for filling in range(2):  # count, then fill
        if filling == 1:
            for row in range(rows):
                start[row + 1] += start[row]
            height, turn = np.empty(start[rows]), np.empty(start[rows], dtype=np.int8)
        cursor = start.copy()
        for m in range(faces.shape[0]):
            ids = faces[m]
            low_i, high_i = _row_range(vertices, ids, 0, shape[0])
            low_j, high_j = (0, 0) if flat else _row_range(vertices, ids, 1, shape[1])
            for i in range(low_i, high_i + 1):
                for j in range(low_j, high_j + 1):
                    sign, z = _cross_segment(vertices, ids, i) if flat else _cross_triangle(vertices, ids, i, j)
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


@njit(cache=True)
def _row_range(vertices, ids, axis, size):  # type: ignore[no-untyped-def]
    low = high = vertices[ids[0], axis]
    for c in range(1, ids.shape[0]):
        low, high = min(low, vertices[ids[c], axis]), max(high, vertices[ids[c], axis])
    return max(0, int(np.ceil(low))), min(size - 1, int(np.floor(high)))


@njit(cache=True)
def _side(vertices, u, v, x, y):  # type: ignore[no-untyped-def]
    """Side (+1 left, -1 right) of the directed edge u -> v that the node (x, y) lies on, never 0.

    The edge is always evaluated from its lower to its higher vertex, so that its two faces see the same number; on the edge the node is
    shifted by (e, e^2).
    """
    flip = 1
    if u > v:
        u, v, flip = v, u, -1
    dx, dy = vertices[v, 0] - vertices[u, 0], vertices[v, 1] - vertices[u, 1]
    value = dx * (y - vertices[u, 1]) - dy * (x - vertices[u, 0])
    if value == 0.0:
        value = -dy if dy != 0.0 else dx
    return flip if value > 0.0 else -flip


@njit(cache=True)
def _cross_triangle(vertices, ids, x, y):  # type: ignore[no-untyped-def]
    """Does the vertical line through (x, y) cross the triangle: -1 upward out of it, +1 into it, 0 no; and the height."""
    a, b, c = ids[0], ids[1], ids[2]
    side = _side(vertices, a, b, x, y)
    if side != _side(vertices, b, c, x, y) or side != _side(vertices, c, a, x, y):
        return 0, 0.0
    ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
    wx, wy, wz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    z = vertices[a, 2]
    if nz != 0.0:
        z -= (nx * (x - vertices[a, 0]) + ny * (y - vertices[a, 1])) / nz
    return -side, z  # counter-clockwise from above: the normal points up, the line leaves


@njit(cache=True)
def _cross_segment(vertices, ids, x):  # type: ignore[no-untyped-def]
    """The same for a segment and the vertical line through x; a vertex on the line belongs to the side of larger x."""
    a, b = ids[0], ids[1]
    xa, xb = vertices[a, 0], vertices[b, 0]
    if (xa <= x) == (xb <= x):
        return 0, 0.0
    t = (x - xa) / (xb - xa)
    return (1 if xa < xb else -1), vertices[a, 1] + t * (vertices[b, 1] - vertices[a, 1])


@njit(cache=True)
def march_simplices(corners, phi, simplices):  # type: ignore[no-untyped-def]
    """Linear zero set of phi on simplices that split each lattice cell (Kuhn), manifold by construction.

    corners (c, 2**d) rows of the cells' corners (bit a of the corner number = step along axis a), simplices (s, d+1) corner numbers along
    rising paths. Returns faces (m, d) of edge keys (row * 2**d + direction) and, per face, the cell and simplex it came from, (m, 2).
    """
    size, count = simplices.shape[1], 0
    wide = corners.shape[1]
    faces, source = np.empty((0, size - 1), dtype=np.int64), np.empty((0, 2), dtype=np.int64)
    inside, outside = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    cut = np.empty(4, dtype=np.int64)
    for filling in range(2):  # count, then fill
        if filling == 1:
            faces, source = np.empty((count, size - 1), dtype=np.int64), np.empty((count, 2), dtype=np.int64)
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
                    for a in range(n_in):  # the four cuts of a quadrilateral in turn round it
                        for b in range(n_out):
                            u, v = inside[a], outside[b if a == 0 else n_out - 1 - b]
                            cut[k] = corners[c, min(u, v)] * wide + (u ^ v)  # along a rising path the smaller number comes first
                            k += 1
                    for f in range(made):
                        for v in range(size - 1):
                            faces[count + f, v] = cut[v if f == 0 or v == 0 else v + 1]
                        source[count + f, 0], source[count + f, 1] = c, s
                count += made
    return faces, source


@njit(cache=True)
def barycentric(points, vertices, faces, owner):  # type: ignore[no-untyped-def]
    """Barycentric weights (k, d) of the point of face owner[k] that is closest to points[k]."""
    weights = np.zeros((points.shape[0], faces.shape[1]))
    for k in range(points.shape[0]):
        f = faces[owner[k]]
        if faces.shape[1] == 3:
            _on_triangle(points[k], vertices[f[0]], vertices[f[1]], vertices[f[2]], weights[k])
        else:
            _on_segment(points[k], vertices[f[0]], vertices[f[1]], weights[k])
    return weights


@njit(cache=True)
def curvature(phi, neighbours, spacing):  # type: ignore[no-untyped-def]
    """div(grad phi / |grad phi|) per node by central differences; phi is continued evenly where the band ends."""
    n, dim = neighbours.shape[0], neighbours.shape[1]
    out = np.zeros(n)
    first, second = np.empty(dim), np.empty((dim, dim))
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
        if norm2 < 1e-12:
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
