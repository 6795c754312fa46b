"""A field of the wall at any place, as the sum of its values at the nodes near to that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ...arrays import Array, Ints
from ...parallel import axes_of, by_rows
from ..field.covariance import interpolation
from .settings import SETTINGS

WORTH = 1000  # places that are worth a thread


@dataclass(frozen=True, eq=False)
class NodeSums:
    """Node sums have for each of n places the nodes near (n, k) to it, of m, and the share (n, k) of each."""

    near: Ints
    share: Array

    @classmethod
    def of(cls, nodes: Array, places: Array, length: float) -> NodeSums:
        """Interpolate a field of a correlation length at places (n, d) from nodes (m, d)."""
        weights = interpolation(nodes, places, length, SETTINGS.neighbours)
        shape = len(places), -1
        return cls(weights.indices.astype(np.int64).reshape(shape), weights.data.reshape(shape))

    def values(self, nodes: Array) -> Array:
        """Return samples (count, n, c) of a field of c components, by those (count, m, c) at the nodes."""
        found = np.empty((len(nodes), len(self.near), nodes.shape[2]))
        by_node = np.ascontiguousarray(nodes.swapaxes(0, 1)).reshape(nodes.shape[1], -1)
        rows = found.swapaxes(0, 1), self.near, self.share
        by_rows(_sum_values, WORTH, rows, axes_of(nodes[0]), by_node)
        return found

    def covariance(self, nodes: Array, components: int) -> Array:
        """Return the covariance (n, c, c) of a field of c components at each place, by that (m c, m c) at the
        nodes, the components of one node behind each other.
        """
        joint = nodes.reshape(len(nodes) // components, components, -1, components)
        blocks = np.ascontiguousarray(joint.swapaxes(1, 2))  # the numbers of a pair of nodes lie together
        total = np.empty((len(self.near), components, components))
        by_rows(_sum_blocks, WORTH, (total, self.near, self.share), axes_of(total[0]), blocks)
        return total


@njit(cache=True, nogil=True)
def _sum_values(found, near, share, axes, nodes):  # type: ignore[no-untyped-def]
    """Fill in found (n, count, c), with nodes (m, count c): what all samples have at a node lies together, so
    that a place's sums are vector instructions.
    """
    sums = np.empty((16, nodes.shape[1]))  # of places whose sums are written together, sample by sample
    for first in range(0, len(near), len(sums)):
        block = range(min(len(sums), len(near) - first))
        for v in block:
            total = sums[v]
            total[:] = 0.0
            for i in range(near.shape[1]):
                node, part = near[first + v, i], share[first + v, i]
                for k in range(len(total)):
                    total[k] += part * nodes[node, k]
        for s in range(found.shape[1]):
            for v in block:
                for a in range(len(axes)):
                    found[first + v, s, a] = sums[v, s * len(axes) + a]


@njit(cache=True, nogil=True)
def _sum_blocks(total, near, share, axes, blocks):  # type: ignore[no-untyped-def]
    """Fill in total (n, c, c), with blocks (m, m, c, c) and for two nodes that of one with the other and its
    transpose.
    """
    half = np.empty((len(axes), len(axes)))
    for v in range(len(total)):
        half[:] = 0.0
        for i in range(near.shape[1]):
            for j in range(i + 1):
                both = (0.5 if i == j else 1.0) * share[v, i] * share[v, j]
                for a in range(len(axes)):
                    for b in range(len(axes)):
                        half[a, b] += both * blocks[near[v, i], near[v, j], a, b]
        for a in range(len(axes)):
            for b in range(len(axes)):
                total[v, a, b] = half[a, b] + half[b, a]
