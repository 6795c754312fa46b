"""Exact signed distance of a closed surface on the nodes of a narrow band around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from ...arrays import Array, Ints
from ...errors import InputError
from ...geometry.closest_point import ClosestPoint
from ...parallel import by_rows
from .band import PAD, Band
from .masks import widened
from .scatter import Blocks, gather_band, scatter_distance, touched_blocks
from .winding import winding


@dataclass(frozen=True, eq=False)
class SignedDistance:
    """This is the signed distance phi (n,), negative inside, on the nodes of `band`, with the closest face
    (n,) of each node.
    """

    band: Band
    phi: Array
    face: NDArray[np.int32]


def signed_distance(
    vertices: Array, faces: Ints, spacing: float, width: float, *, inverted: bool = True
) -> SignedDistance:
    """Return the distance of the nodes within `width` (length) of a closed surface: exact but for float32
    rounding.

    vertices (v, d), faces (m, d), d = 2 or 3. Inside is where the surface winds round a node: parts that
    overlap are united. inverted: whether what it winds round the other way, as a part that a fold turned
    inside out, is inside too. Raises InputError where the surface is open.
    """
    dimension = vertices.shape[1]
    low, box, local = _enclose_surface(vertices, spacing, width)
    nodes, gap, face = _scatter_unsigned(local[faces], width / spacing, box, dimension)
    band = Band(
        spacing,
        width,
        low,
        tuple(int(n) for n in box[:dimension]),
        np.ascontiguousarray(nodes[:, :dimension]),
    )
    return SignedDistance(
        band, np.where(_are_inside(nodes, local, faces, box, inverted=inverted), -gap, gap) * spacing, face
    )


def filled_distance(vertices: Array, faces: Ints, spacing: float, steps: int) -> SignedDistance:
    """Return the signed distance on all nodes inside a closed surface and on those within `steps` nodes of
    these: for coarse lattices only.
    """
    dimension = vertices.shape[1]
    low, box, local = _enclose_surface(vertices, spacing, steps * spacing)
    every = np.ascontiguousarray(np.indices(tuple(box)).reshape(3, -1).T, dtype=np.int32)
    inside = _are_inside(every, local, faces, box)
    near = binary_dilation(inside.reshape(box[:dimension]), iterations=steps).ravel()
    band = Band(
        spacing,
        steps * spacing,
        low,
        tuple(int(n) for n in box[:dimension]),
        np.ascontiguousarray(every[near, :dimension]),
    )
    squared, face, _, _ = ClosestPoint(vertices, faces).query(band.positions)
    return SignedDistance(band, np.sqrt(squared) * np.where(inside[near], -1.0, 1.0), face.astype(np.int32))


def around_zero(box: Array, spacing: float, width: float, low: Ints) -> SignedDistance:
    """Return the nodes of a level set on a box (3D) that its zero set needs, without their closest faces
    (-1): no distance, if that on the box is none.
    """
    near = widened((box < 0.0) & widened(box >= 0.0, corners=True), corners=True)
    nodes = np.ascontiguousarray(np.argwhere(near), dtype=np.int32)
    band = Band(spacing, width, low, box.shape, nodes)
    return SignedDistance(band, box[near], np.full(len(band), -1, dtype=np.int32))


def _enclose_surface(vertices: Array, spacing: float, width: float) -> tuple[Ints, Ints, Array]:
    """Return the box that holds a surface and its band: its first lattice index (d,), its shape (3,), and the
    vertices (v, 3) in its units.
    """
    dimension = vertices.shape[1]
    low = np.floor((vertices.min(axis=0) - width) / spacing).astype(np.int64) - PAD
    box = np.ones(3, dtype=np.int64)
    box[:dimension] = np.ceil((vertices.max(axis=0) + width) / spacing).astype(np.int64) + PAD + 1 - low
    local = np.zeros((len(vertices), 3))
    local[:, :dimension] = vertices / spacing - low
    return low, box, local


def _are_inside(
    nodes: NDArray[np.int32], local: Array, faces: Ints, box: Ints, *, inverted: bool = True
) -> NDArray[np.bool_]:
    number, open_rows = winding(nodes, local, faces, box)
    if open_rows:
        raise InputError(
            f"the surface is open ({open_rows} lattice rows enter it and never leave): it must be "
            "closed, cap its holes first"
        )
    return np.asarray((number != 0) if inverted else (number > 0))


def _spread_faces(count: int) -> Ints:
    """Return an order of so many faces in which every 64th comes first, then every eighth, so that each node
    soon has one that is near.
    """
    number = np.arange(count)
    return np.argsort((number % 64 > 0).astype(int) + (number % 8 > 0), kind="stable")


def _scatter_unsigned(
    corners: Array, reach: float, box: Ints, dimension: int
) -> tuple[NDArray[np.int32], Array, NDArray[np.int32]]:
    bits = 3 if dimension == 3 else 0  # blocks of 8 x 8 x 8 or 8 x 8 x 1 nodes
    table, count = touched_blocks(corners, reach, box, bits)
    best = np.full((count, 64 << bits), np.inf, dtype=np.float32)
    owner = np.full(best.shape, -1, dtype=np.int32)
    blocks = Blocks(box, bits, table, best, owner)
    layers = (np.arange(len(table)),)
    # two layers of blocks are worth a thread
    by_rows(scatter_distance, 2, layers, _spread_faces(len(corners)), corners, reach, blocks)
    nodes, gap, face = gather_band(blocks)
    return nodes, gap, face
