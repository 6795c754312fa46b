"""Exact signed distance of a closed surface on the nodes of a narrow band around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry import Array, Ints
from .closest import ClosestPoint
from .grid import PAD, Band
from .kernels import gather_band, scatter_distance, touched_blocks, winding


@dataclass(frozen=True, eq=False)
class SignedDistance:
    """Signed distance phi (n,), negative inside, on the nodes of `band`, and the closest face (n,) of each node."""

    band: Band
    phi: Array
    face: NDArray[np.int32]


def signed_distance(vertices: Array, faces: Ints, spacing: float, width: float) -> SignedDistance:
    """Distance of the nodes within `width` (length) of a closed surface: exact but for float32 rounding.

    vertices (v, d), faces (m, d), d = 2 or 3. Inside is where the surface winds round a node at least once, so parts that overlap are
    united. Raises InputError where the surface is open.
    """
    dimension = vertices.shape[1]
    reach = width / spacing
    low = np.floor(vertices.min(axis=0) / spacing - reach).astype(np.int64) - PAD
    shape = (np.ceil(vertices.max(axis=0) / spacing + reach).astype(np.int64) + PAD + 1) - low
    local = np.zeros((len(vertices), 3))
    local[:, :dimension] = vertices / spacing - low
    box = np.append(shape, 1)[:3]
    nodes, gap, face = _unsigned(local[faces], reach, box, dimension)
    number, open_rows = winding(nodes, local, faces, box)
    if open_rows:
        raise InputError(f"the surface is open ({open_rows} lattice rows enter it and never leave): it must be closed, cap its holes first")
    band = Band(spacing, width, low, tuple(int(n) for n in shape), np.ascontiguousarray(nodes[:, :dimension]))
    return SignedDistance(band, np.where(number > 0, -gap, gap) * spacing, face)


def filled_distance(vertices: Array, faces: Ints, spacing: float, width: float) -> SignedDistance:
    """Signed distance on all nodes inside a closed surface and on those within `width` outside: for coarse lattices, as its size is a volume."""
    shell = signed_distance(vertices, faces, spacing, width)
    band = shell.band
    local = np.zeros((len(vertices), 3))
    local[:, : band.dimension] = vertices / spacing - band.low
    box = np.ones(3, dtype=np.int64)
    box[: band.dimension] = band.shape
    every = np.indices(tuple(box)).reshape(3, -1).T.astype(np.int32)
    number, _ = winding(every, local, faces, box)
    chosen = number > 0
    chosen[band.keys] = True
    filled = Band(spacing, width, band.low, band.shape, np.ascontiguousarray(every[chosen, : band.dimension]))
    squared, face, _, _ = ClosestPoint(vertices, faces).query(filled.positions)
    return SignedDistance(filled, np.sqrt(squared) * np.where(number[chosen] > 0, -1.0, 1.0), face.astype(np.int32))


def _unsigned(corners: Array, reach: float, box: Ints, dimension: int) -> tuple[NDArray[np.int32], Array, NDArray[np.int32]]:
    bits = 3 if dimension == 3 else 0  # blocks of 8 x 8 x 8 or 8 x 8 x 1 nodes
    table, count = touched_blocks(corners, reach, box, bits)
    best, owner = scatter_distance(corners, reach, box, bits, table, count)
    nodes, gap, face = gather_band(table, bits, box, best, owner)
    return nodes, gap, face
