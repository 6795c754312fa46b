"""Unsigned distance by scatter: every triangle (3D) or segment (2D) writes to the nodes near it, kept in
blocks of the lattice.

A 2D box has a third axis of length 1 and blocks of thickness 1.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def touched_blocks(corners, reach, shape, bits):  # type: ignore[no-untyped-def]
    """Number the blocks of 2**bits nodes that a face's box, grown by `reach` nodes, can touch; -1 elsewhere.

    corners (m, c, 3) in lattice units. Returns the table (blocks per axis) and the count.
    """
    table = np.full(
        (shape[0] + 7 >> 3, shape[1] + 7 >> 3, (shape[2] + (1 << bits) - 1) >> bits), -1, dtype=np.int32
    )
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


@njit(cache=True, nogil=True)
def scatter_distance(layers, corners, reach, shape, bits, table, best, owner):  # type: ignore[no-untyped-def]
    """Fill in the smallest distance (lattice units) of the nodes within `reach` to any face, and that
    face, per block, in adjoining layers of blocks along the first axis.

    A face looks along the rows of its grown box, only where its plane and its bounding sphere are within
    reach; most of these nodes are turned away by a bound, the distance from the sphere or the circle around
    the face, that their best face so far already beats.
    """
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    shape_of = np.empty(13)
    mask = (1 << bits) - 1
    flat = corners.shape[1] == 2
    for m in range(corners.shape[0]):
        face = corners[m]
        _face_box(face, reach, shape, first, last)
        first[0], last[0] = max(first[0], layers[0] << 3), min(last[0], (layers[-1] << 3) + 7)
        if first[0] > last[0]:
            continue
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
                low = max(first[2], int(np.ceil(cz - half)))
                high = min(last[2], int(np.floor(cz + half)))
                tilt = (i - ax) * nx + (j - ay) * ny
                if abs(nz) > 1e-3:
                    up = az + (reach - tilt) / nz
                    down = az - (reach + tilt) / nz
                    low = max(low, int(np.ceil(min(up, down) - 1e-9)))
                    high = min(high, int(np.floor(max(up, down) + 1e-9)))
                row = ((i & 7) << 3 | (j & 7)) << bits
                for k in range(low, high + 1):
                    block = table[i >> 3, j >> 3, k >> bits]
                    limit = min(np.float64(best[block, row | (k & mask)]), reach)
                    centre2 = aside2 + (k - cz) ** 2
                    if centre2 > (limit + radius) ** 2:
                        continue
                    away = tilt + (k - az) * nz
                    if abs(away) > limit:
                        continue
                    # the centre lies in the plane: what is along it and outside the circle comes on top
                    along = np.sqrt(max(centre2 - away * away, 0.0)) - radius
                    if along > 0.0 and away * away + along * along > limit * limit:
                        continue
                    x, y, z = i - ax, j - ay, k - az
                    gap2 = _segment_gap2(x, y, shape_of) if flat else _triangle_gap2(x, y, z, away, shape_of)
                    if gap2 <= limit * limit:
                        best[block, row | (k & mask)] = np.sqrt(gap2)
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
        radius2 = max(
            radius2, (face[c, 0] - out[0]) ** 2 + (face[c, 1] - out[1]) ** 2 + (face[c, 2] - out[2]) ** 2
        )
    out[3] = np.sqrt(radius2) * (1.0 + 1e-9) + 1e-6  # float32 distances may be this much too short
    ux, uy, uz, vx, vy, vz = out[7], out[8], out[9], out[10], out[11], out[12]
    x, y, z = (uy, -ux, 0.0) if corners == 2 else (uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)
    length = np.sqrt(x * x + y * y + z * z)
    shrink = 1.0 / length if length > 1e-12 * radius2 and length > 0.0 else 0.0
    out[4], out[5], out[6] = x * shrink, y * shrink, z * shrink


@njit(cache=True, inline="always")
def _segment_gap2(x, y, face):  # type: ignore[no-untyped-def]
    """Squared distance from a point, given from corner a, to a segment."""
    along = x * face[7] + y * face[8]
    length2 = face[7] ** 2 + face[8] ** 2
    t = min(1.0, max(0.0, along / length2)) if length2 > 0.0 else 0.0
    return (x - t * face[7]) ** 2 + (y - t * face[8]) ** 2


@njit(cache=True, inline="always")
def _triangle_gap2(x, y, z, away, face):  # type: ignore[no-untyped-def]
    """Squared distance from a point, given from corner a, to a triangle: `away`^2 above its inside, else the
    nearest edge's.
    """
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
    gap = np.empty(n)
    face = np.empty(n, dtype=np.int32)
    at = 0
    for i in range(shape[0]):
        for j in range(shape[1]):
            row = ((i & 7) << 3 | (j & 7)) << bits
            for bk in range(table.shape[2]):
                block = table[i >> 3, j >> 3, bk]
                for c in range(1 << bits if block >= 0 else 0):
                    if owner[block, row + c] >= 0:
                        nodes[at, 0] = i
                        nodes[at, 1] = j
                        nodes[at, 2] = (bk << bits) + c
                        gap[at] = best[block, row + c]
                        face[at] = owner[block, row + c]
                        at += 1
    return nodes, gap, face
