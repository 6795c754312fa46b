"""The inside of a level set on a box of nodes (3D) as one simply connected piece.

The inside is grown from its deepest node, deepest nodes first, by such as change no topology ("simple
points"), in the triangulation of the lattice that the zero set is taken from (Kuhn 1960). So what is left out
cuts handles where they are thinnest.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numba import njit

from ...arrays import Array, Ints, Mask
from .masks import widened

# neighbours in Kuhn's triangulation: steps of 0 and 1, or of 0 and -1
STEPS = np.array([step for step in product((-1, 0, 1), repeat=3) if any(step) and min(step) * max(step) >= 0])
TOUCHING = np.zeros((3, 3, 3), dtype=bool)
TOUCHING[tuple(np.vstack([STEPS, [[0, 0, 0]]]).T + 1)] = True


@cache
def _simple_patterns() -> Mask:
    """Say for every pattern of a node's neighbours (bit k: neighbour k is inside) whether the node can join
    or leave the inside without a change of topology: inside and outside are one piece each on the sphere of
    neighbours.
    """
    count = len(STEPS)
    touching = np.array(
        [[any(((a - b) == step).all() for step in STEPS) for b in STEPS] for a in STEPS], dtype=np.bool_
    )
    bits = touching @ (1 << np.arange(count))
    return np.array(
        [
            _count_pieces(k, bits) == 1 and _count_pieces(~k & (1 << count) - 1, bits) == 1
            for k in range(1 << count)
        ]
    )


def _count_pieces(pattern: int, bits: Ints) -> int:
    """Count the connected pieces of a pattern."""
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


def simply_connected(phi: Array, least: float, left: Mask | None = None) -> Array:
    """Return phi on a box with its inside made one simply connected piece: what is made outside becomes at
    least `least`. left: what the inside leaves out (mask) where that is known, as `unreached` gives it.
    """
    left = unreached(phi) if left is None else left
    # the second time around the nodes left out, which makes a cut as wide as the lattice can hold
    for _ in range(2):
        if not left.any():
            break
        phi = cut_away(phi, left, least)
        left = unreached(phi)
    return np.where(left, least, phi)


def cut_away(phi: Array, nodes: Mask, least: float) -> Array:
    """Return phi with the inside at nodes (mask) and next to them made outside."""
    wider = widened(nodes) & (phi < 0.0)
    return np.where(wider, np.maximum(-phi, least), phi)


class _Queue(NamedTuple):
    """A queue has the rank of every node, or -1; by rank, it has which nodes wait, and how many of each
    chunk.
    """

    rank: Ints
    queued: Mask
    waiting: Ints


@njit(cache=True, inline="always")
def _queue_around(node, inside, offsets, queue, first):  # type: ignore[no-untyped-def]
    """Queue the neighbours of a node that may join the inside; the lowest rank that waits, or `first`."""
    rank, queued, waiting = queue
    for k in range(len(offsets)):
        other = node + offsets[k]
        place = rank[other]
        if place >= 0 and not (inside[other] or queued[place]):
            queued[place] = True
            waiting[place >> 8] += 1
            first = min(first, place)
    return first


@njit(cache=True, nogil=True)
def _grow_in_place(nodes, rank, inside, simple, offsets):  # type: ignore[no-untyped-def]
    """Add to the inside (mask, in place) nodes next to it by simple additions, the first in `nodes` first.

    rank: of every node of the box among these, or -1.
    """
    queued = np.zeros(len(nodes), np.bool_)
    waiting = np.zeros((len(nodes) >> 8) + 2, np.int64)  # counts of nodes that wait, per chunk of the queue
    queue = _Queue(rank, queued, waiting)
    first = len(nodes)
    for start in np.flatnonzero(inside):
        first = _queue_around(start, inside, offsets, queue, first)
    while first < len(nodes):
        if waiting[first >> 8] == 0:
            first = ((first >> 8) + 1) << 8
            continue
        if not queued[first]:
            first += 1
            continue
        node = nodes[first]
        queued[first] = False  # one that is not simple now may be when another neighbour has joined
        waiting[first >> 8] -= 1
        pattern = 0
        for k in range(len(offsets)):
            if inside[node + offsets[k]]:
                pattern |= 1 << k
        if simple[pattern]:
            inside[node] = True
            first = _queue_around(node, inside, offsets, queue, first)


def _grow_inside(phi: Array, start: Mask) -> Mask:
    """Return the inside (mask) grown from `start` by simple additions of negative nodes, the lowest first;
    the border of the box is not grown.
    """
    offsets = STEPS @ np.array([phi.shape[1] * phi.shape[2], phi.shape[2], 1])
    inside = np.ascontiguousarray(start).ravel().copy()
    nodes = np.flatnonzero((phi.ravel() < 0.0) & ~inside)
    nodes = nodes[_sort_roughly(phi.ravel()[nodes])]
    rank = np.full(phi.size, -1, dtype=np.int32)
    rank[nodes] = np.arange(len(nodes))
    _grow_in_place(nodes, rank, inside, _simple_patterns(), offsets)
    return inside.reshape(phi.shape)


def _sort_roughly(values: Array) -> Ints:
    """Return the indices (n,) that sort values to 2^-16 of their range. Values that are equal then stay in
    order: such short numbers are sorted without comparing them.
    """
    least, most = values.min(initial=np.inf), values.max(initial=-np.inf)
    steps = (2.0**16 - 1.0) / (most - least) if most > least else 0.0
    return np.argsort(((values - least) * steps).astype(np.uint16), kind="stable")


def unreached(phi: Array, begun: Mask | None = None) -> Mask:
    """Return the nodes inside (mask) that are not reached from the deepest one, or from those that have
    `begun` (mask): they cut handles, or are islands.
    """
    if begun is None or not begun.any():
        begun = np.zeros(phi.shape, dtype=bool)
        begun[np.unravel_index(np.argmin(phi), phi.shape)] = True
    grown = _grow_inside(np.pad(phi, 1, constant_values=1.0), np.pad(begun, 1))
    return (phi < 0.0) & ~grown[1:-1, 1:-1, 1:-1]


def outside(phi: Array) -> Mask:
    """Return the nodes outside (mask) that are reached from beyond the box; the others fill tunnels or
    pockets.
    """
    around = np.pad(np.pad(-phi, 1, constant_values=-np.inf), 1, constant_values=1.0)
    start = np.zeros(around.shape, dtype=bool)
    start[1:-1, 1:-1, 1:-1] = True
    start[2:-2, 2:-2, 2:-2] = False
    return _grow_inside(around, start)[2:-2, 2:-2, 2:-2]
