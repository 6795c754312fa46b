"""Unsigned distance by scatter: every triangle (3D) or segment (2D) writes to the nodes near it, kept in
blocks of the lattice.

A 2D box has a third axis of length 1 and blocks of thickness 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ...arrays import Ints


class Blocks(NamedTuple):
    """Blocks of 8 x 8 x 2**bits nodes of a lattice of a shape (3,) are numbered in a table. For every node of
    each they have the best distance so far, and the face that it is from; -1 where there is none.
    """

    shape: Ints
    bits: int
    table: NDArray[np.int32]
    best: NDArray[np.float32]
    owner: NDArray[np.int32]


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _face_box(face, reach, shape, first, last):  # type: ignore[no-untyped-def]
    """Return the first and last node per axis of a face's box grown by `reach`, clipped to the lattice."""
    for a in range(3):
        low = high = face[0, a]
        for c in range(1, face.shape[0]):
            low, high = min(low, face[c, a]), max(high, face[c, a])
        first[a] = max(0, int(np.ceil(low - reach)))
        last[a] = min(shape[a] - 1, int(np.floor(high + reach)))


@njit(cache=True, nogil=True)
def scatter_distance(layers, order, corners, reach, blocks):  # type: ignore[no-untyped-def]
    """Fill in the smallest distance (lattice units) of the nodes within `reach` to any face, and that
    face, per block, in adjoining layers of blocks along the first axis; faces in the order given.

    A face looks at the layers of nodes of the blocks that its grown box touches. All nodes of a layer at once
    are turned away by a bound, their distance from the circle around the face, which their best face so far
    already beats: the sooner each has a good one, the more.
    """
    shape, bits, table, best, owner = blocks
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    shape_of = np.empty(13)
    lanes = 8 << bits  # nodes of a layer
    thick = 1 << bits
    across = np.arange(lanes)
    steps = (across >> bits).astype(np.float32), (across & (thick - 1)).astype(np.float32)
    spare = np.empty(lanes, dtype=np.float32)
    worst = np.full((best.shape[0], 8), reach)  # distance of a layer's node that is farthest off
    for m in order:
        _face_box(corners[m], reach, shape, first, last)
        first[0], last[0] = max(first[0], layers[0] << 3), min(last[0], (layers[-1] << 3) + 7)
        if first[0] > last[0]:
            continue
        _measure_face(corners[m], shape_of)
        cx, cy, cz, radius = shape_of[:4]
        for bj in range(first[1] >> 3, (last[1] >> 3) + 1):
            y = (bj << 3) - cy
            for bk in range(first[2] >> bits, (last[2] >> bits) + 1):
                z = (bk << bits) - cz
                beside2 = max(y, -y - 7.0, 0.0) ** 2 + max(z, 1.0 - thick - z, 0.0) ** 2
                for i in range(first[0], last[0] + 1):
                    block, layer = table[i >> 3, bj, bk], i & 7
                    if (i - cx) ** 2 + beside2 > (worst[block, layer] + radius) ** 2:
                        continue
                    mine = best[block, layer * lanes : (layer + 1) * lanes]
                    if _count_candidates(mine, steps, (i - cx, y, z), shape_of, reach, spare) == 0:
                        continue
                    theirs = owner[block, layer * lanes : (layer + 1) * lanes]
                    nearer = False
                    for c in range(lanes):
                        k = (bk << bits) + (c & (thick - 1))
                        if spare[c] > 0.0 and k <= last[2]:
                            gap2 = _face_gap2((i, (bj << 3) + (c >> bits), k), corners[m], shape_of)
                            limit = min(np.float64(mine[c]), reach)
                            if gap2 <= limit * limit:
                                mine[c], theirs[c], nearer = np.sqrt(gap2), m, True
                    if nearer:
                        worst[block, layer] = min(reach, mine.max())


# without the promise of finite numbers that fastmath=True makes: the best distances begin infinite
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _count_candidates(best, steps, start, face, reach, spare):  # type: ignore[no-untyped-def]
    """Count the nodes of a layer that a face may be nearer to than the best face so far: those where `spare`,
    the difference of squared distances from that face and from the circle around this one, is positive.

    start: the layer's first node, from the centre of the circle; steps: of all its nodes from there, in y and
    in z. In single precision, of which the processor does many at once, with room for its rounding.
    """
    steps_y, steps_z = steps
    x, y0, z0 = np.float32(start[0]), np.float32(start[1]), np.float32(start[2])
    nx, ny, nz = np.float32(face[4]), np.float32(face[5]), np.float32(face[6])
    radius, most = np.float32(face[3] + 1e-4), np.float32(reach + 1e-4)
    zero, count = np.float32(0.0), np.int32(0)
    for c in range(len(spare)):
        y, z = y0 + steps_y[c], z0 + steps_z[c]
        away = x * nx + y * ny + z * nz
        along2 = x * x + y * y + z * z - away * away
        along = np.sqrt(along2 if along2 > zero else zero) - radius
        along = along if along > zero else zero
        limit = best[c] if best[c] < most else most
        more = limit * limit - (away * away + along * along)
        spare[c] = more
        count += np.int32(more > zero)
    return count


@njit(cache=True, inline="always")
def _face_gap2(node, corners, face):  # type: ignore[no-untyped-def]
    """Return the squared distance of a node from a face with these corners, measured by `_measure_face`."""
    x, y, z = node[0] - corners[0, 0], node[1] - corners[0, 1], node[2] - corners[0, 2]
    if len(corners) == 2:
        gap2 = _segment_gap2(x, y, face)
    else:
        gap2 = _triangle_gap2(x, y, z, x * face[4] + y * face[5] + z * face[6], face)
    return gap2


@njit(cache=True, nogil=True)
def _measure_face(face, out):  # type: ignore[no-untyped-def]
    """Write the centre (3), radius, unit normal (3; zero where there is no area), edges ab (3) and ac (3) of
    a face.
    """
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
    """Return the squared distance from a point, given from corner a, to a segment."""
    along = x * face[7] + y * face[8]
    length2 = face[7] ** 2 + face[8] ** 2
    t = min(1.0, max(0.0, along / length2)) if length2 > 0.0 else 0.0
    return (x - t * face[7]) ** 2 + (y - t * face[8]) ** 2


@njit(cache=True, inline="always")
def _triangle_gap2(x, y, z, away, face):  # type: ignore[no-untyped-def]
    """Return the squared distance from a point, given from corner a, to a triangle: `away`^2 above its
    inside, else the nearest edge's.
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


@njit(cache=True, nogil=True)
def gather_band(blocks):  # type: ignore[no-untyped-def]
    """Gather the nodes that have an owner, in C order: indices (n, 3), distance (n,), face (n,)."""
    shape, bits, table, best, owner = blocks
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
