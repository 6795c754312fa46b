"""Topology of a level set on a box of nodes: one piece without handles or cavities.

The inside is grown from its deepest node, deepest nodes first, by such as change no topology ("simple
points"), in the triangulation of the lattice that the zero set is taken from (Kuhn 1960). So what is left out
cuts handles where they are thinnest.
"""

from __future__ import annotations

import heapq
from functools import cache
from itertools import product

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from ...arrays import Array, Ints

# neighbours in Kuhn's triangulation: steps of 0 and 1, or of 0 and -1
STEPS = np.array([step for step in product((-1, 0, 1), repeat=3) if any(step) and min(step) * max(step) >= 0])


@cache
def _simple_patterns() -> NDArray[np.bool_]:
    """For every pattern of a node's neighbours (bit k: neighbour k is inside) whether the node can join or
    leave the inside without a change of topology: inside and outside are one piece each on the sphere of
    neighbours.
    """
    count = len(STEPS)
    touching = np.array(
        [[any(((a - b) == step).all() for step in STEPS) for b in STEPS] for a in STEPS], dtype=np.bool_
    )
    bits = touching @ (1 << np.arange(count))
    return np.array(
        [_pieces(k, bits) == 1 and _pieces(~k & (1 << count) - 1, bits) == 1 for k in range(1 << count)]
    )


def _pieces(pattern: int, bits: Ints) -> int:
    """Number of connected pieces of a pattern."""
    pieces = 0
    while pattern:
        pieces += 1
        piece = pattern & -pattern
        reached = 0
        while piece != reached:
            reached = piece
            for k in range(len(bits)):
                if piece >> k & 1:
                    piece |= int(bits[k]) & pattern
        pattern &= ~piece
    return pieces


def without_handles(phi: Array, least: float) -> Array:
    """phi on a box with its inside cut into one simply connected piece: what is left out becomes at least
    `least`.
    """
    for _ in range(2):  # the second time around what was left out: a cut as wide as the lattice can hold
        inside = grown(np.ascontiguousarray(phi), _simple_patterns())
        left_out = (phi < 0.0) & ~inside
        if not left_out.any():
            return phi
        wider = binary_dilation(left_out) & (phi < 0.0)
        phi = np.where(wider, np.maximum(-phi, least), phi)
    return np.where((phi < 0.0) & ~grown(phi, _simple_patterns()), least, phi)


@njit(cache=True)
def _grown(flat, simple, offsets):  # type: ignore[no-untyped-def]
    """Nodes of the inside that can be reached by simple additions."""
    inside = np.zeros(len(flat), np.bool_)
    queued = np.zeros(len(flat), np.bool_)
    start = np.argmin(flat)
    queue = [(flat[start], start)]
    first = True
    while len(queue) > 0:
        _, node = heapq.heappop(queue)
        queued[node] = False  # one that is not simple now may be when another neighbour has joined
        if not first:
            pattern = 0
            for k in range(len(offsets)):
                if inside[node + offsets[k]]:
                    pattern |= 1 << k
            if not simple[pattern]:
                continue
        first = False
        inside[node] = True
        for k in range(len(offsets)):
            other = node + offsets[k]
            if flat[other] < 0.0 and not (inside[other] or queued[other]):
                queued[other] = True
                heapq.heappush(queue, (flat[other], other))
    return inside


def grown(phi: Array, simple: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest inside (mask) that grows from the deepest node by simple nodes; the box's border is
    outside.
    """
    closed = phi.copy()
    for axis in range(3):
        for end in (0, -1):
            closed[(slice(None),) * axis + (end,)] = np.abs(closed[(slice(None),) * axis + (end,)])
    offsets = STEPS @ np.array([phi.shape[1] * phi.shape[2], phi.shape[2], 1])
    return np.asarray(_grown(closed.ravel(), simple, offsets).reshape(phi.shape))
