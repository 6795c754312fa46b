"""Narrow bands: the nodes of a regular lattice that lie near a surface, and nothing else.

Sign convention of the whole package: a level set is NEGATIVE INSIDE, zero on the surface, positive outside,
and its gradient points outward (the paper has positive inside; formulas in comments are in our sign). Memory
and work grow with the surface, not with the box.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ...arrays import Array, Ints

PAD = 2  # empty nodes kept around the band, so that the box's border is outside


@dataclass(frozen=True, eq=False)
class Band:
    """A band is the set of nodes of the lattice `spacing * Z^d` within `width` of a surface.

    low (d,): lattice index of the box's first node; shape (d,): nodes of the box; nodes (n, d): indices
    inside the box in C order.
    """

    spacing: float
    width: float
    low: Ints
    shape: tuple[int, ...]
    nodes: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.nodes)

    @property
    def dimension(self) -> int:
        return len(self.shape)

    @property
    def origin(self) -> Array:
        """Position (d,) of the box's first node."""
        return np.asarray(self.low * self.spacing)

    @cached_property
    def positions(self) -> Array:
        """Positions of the nodes, (n, d)."""
        return np.asarray((self.nodes + self.low) * self.spacing, dtype=np.float64)

    @cached_property
    def keys(self) -> Ints:
        """Flat index of every node in the box, ascending, (n,)."""
        return np.asarray(np.ravel_multi_index(tuple(self.nodes.T), self.shape), dtype=np.int64)

    def find(self, indices: NDArray[np.integer]) -> Ints:
        """Return the row of each lattice index (k, d) of the box, or -1 where it is not in the band."""
        inside = np.asarray(((indices >= 0) & (indices < self.shape)).all(axis=1))
        keys = np.ravel_multi_index(tuple(np.where(inside[:, None], indices, 0).T), self.shape)
        return self._find_rows(np.asarray(keys, dtype=np.int64), inside)

    def _find_rows(self, keys: Ints, valid: NDArray[np.bool_]) -> Ints:
        rows = np.minimum(np.searchsorted(self.keys, keys), len(self) - 1)
        return np.where(valid & (self.keys[rows] == keys), rows, -1)

    @cached_property
    def neighbours(self) -> NDArray[np.int32]:
        """Rows of the previous and the next node along every axis, (n, d, 2); -1 where the band ends."""
        from .kernels import rows_of

        pairs = np.full((len(self), self.dimension, 2), -1, dtype=np.int32)
        for axis, size in enumerate(self.shape):
            stride = int(np.prod(self.shape[axis + 1 :]))
            after = rows_of(self.keys, self.keys + stride)
            after[self.nodes[:, axis] == size - 1] = -1
            there = np.flatnonzero(after >= 0)
            pairs[:, axis, 1] = after
            pairs[after[there], axis, 0] = there
        return pairs

    def interpolation(self, points: Array) -> sparse.csr_matrix:
        """Return the multilinear interpolation from nodes to points, a (k, n) matrix whose rows sum to 1 (to
        0 where no corner is in the band).

        Corners outside the band leave their weight to the others.
        """
        local = points / self.spacing - self.low
        base = np.floor(local).astype(np.int64)
        part = local - base
        rows, columns, weights = [], [], []
        for corner in product((0, 1), repeat=self.dimension):
            weight = np.prod(np.where(corner, part, 1.0 - part), axis=1)
            column = self.find(base + np.array(corner))
            keep = (column >= 0) & (weight > 0.0)
            rows.append(np.flatnonzero(keep))
            columns.append(column[keep])
            weights.append(weight[keep])
        at = (np.concatenate(rows), np.concatenate(columns))
        shape = (len(points), len(self))
        matrix = sparse.csr_matrix((np.concatenate(weights), at), shape=shape)
        total = np.asarray(matrix.sum(axis=1)).ravel()
        return sparse.csr_matrix(sparse.diags(1.0 / np.where(total > 0.0, total, 1.0)) @ matrix)

    def whole(self, values: Array, elsewhere: float) -> tuple[Band, Array]:
        """Return all nodes of the box as a band, with the values given on this one and `elsewhere` on the
        rest: for small, coarse boxes.
        """
        nodes = np.indices(self.shape).reshape(self.dimension, -1).T.astype(np.int32)
        every = np.full(len(nodes), elsewhere)
        every[self.keys] = values
        return Band(self.spacing, self.width, self.low, self.shape, np.ascontiguousarray(nodes)), every

    def dense(self, phi: Array) -> NDArray[np.float32]:
        """Return the level set on the whole box, float32: +width outside the band, -width inside it."""
        from .kernels import fill_far

        box = np.full(self.shape, np.float32(self.width), dtype=np.float32)
        fill_far(box.reshape(-1, self.shape[-1]), self.keys, phi, self.width)
        return box
