"""Topology of a level set on a box of nodes: one piece without cavities, and without handles but such as
points show.

The inside is grown from its deepest node, deepest nodes first, by such as change no topology ("simple
points"), in the triangulation of the lattice that the zero set is taken from (Kuhn 1960). So what is left out
cuts handles where they are thinnest. Grown from the border, the outside leaves out what fills tunnels where
they are narrowest. Of the two the likelier is done, where points say nothing the smaller change (as Han, Xu,
Braga-Neto and Prince 2002 do).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import product

import numpy as np
from numba import njit
from scipy.ndimage import label

from ...arrays import Array, Ints, Mask
from ..grid.masks import widened
from .settings import HandleSettings

Evidence = Callable[[tuple[Array, ...], Mask], list[float]]

# neighbours in Kuhn's triangulation: steps of 0 and 1, or of 0 and -1
STEPS = np.array([step for step in product((-1, 0, 1), repeat=3) if any(step) and min(step) * max(step) >= 0])
TOUCHING = np.zeros((3, 3, 3), dtype=bool)
TOUCHING[tuple(np.vstack([STEPS, [[0, 0, 0]]]).T + 1)] = True


@cache
def _simple_patterns() -> Mask:
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


def without_handles(
    phi: Array, evidence: Evidence, settings: HandleSettings, least: float, asked: float
) -> Array:
    """phi on a box with its inside made one simply connected piece, but for handles that points show; what is
    changed becomes at least `least` in amount.

    evidence: log likelihoods of points near changed nodes (mask) under several phi; asked: nodes that the cut
    of a handle takes for it to be asked.
    """
    left_out = _left_out(phi)
    decided, kept = _handles_decided(phi, left_out, evidence, settings, least, asked)
    whole = np.where(kept, least, decided)
    if kept.any() or decided is not phi:
        left_out = _left_out(whole)
    for _ in range(2):  # the second time around what was left out: a cut as wide as the lattice can hold
        if not left_out.any():
            break
        whole = _cut(whole, left_out, least)
        left_out = _left_out(whole)
    return np.where(kept, decided, np.where(left_out, least, whole))


def _handles_decided(
    phi: Array, left_out: Mask, evidence: Evidence, settings: HandleSettings, least: float, asked: float
) -> tuple[Array, Mask]:
    """phi where every larger handle was cut, or its tunnel filled, or left, and nodes (mask) that would cut
    those that were left. `left_out` is what the inside leaves out, when grown.
    """
    kept = np.zeros(phi.shape, dtype=bool)
    cuts = label(left_out, TOUCHING)[0]
    sizes = np.bincount(cuts.ravel())
    sizes[0] = 0
    for k in np.argsort(-sizes, kind="stable")[: settings.most_handles]:
        if sizes[k] < asked:
            break
        mine = cuts == k
        tunnel, disc = _tunnel(np.where(left_out & ~mine, least, phi), sizes[k], settings, least)
        severed = _cut(phi, mine, least)
        filled = np.where(disc, np.minimum(-phi, -least), phi)
        if not tunnel.any():  # an island
            phi = severed
            continue
        changed = (severed != phi) | (filled != phi)
        as_it_is, without, closed = evidence((phi, severed, filled), changed)
        if as_it_is - max(without, closed) > settings.evidence:
            kept |= mine
        elif closed - np.log(_size(tunnel)) >= without - np.log(sizes[k]):
            phi = filled
        else:
            phi = severed
    return phi, kept


def _tunnel(phi: Array, cut: int, settings: HandleSettings, least: float) -> tuple[Mask, Mask]:
    """Nodes (mask) that fill the tunnel of a phi with one handle, which it takes `cut` nodes to cut, where it
    is narrowest, and these as wide as the lattice can hold; none where nothing does, as where the inside is
    in two.
    """
    deep = phi < -least
    begun = deep & ~_left_out(np.where(deep, phi, least))  # grown first, whatever is filled

    def spares(nodes: Mask) -> bool:
        """Whether the handle needs no cut when they are filled, but for a node or two elsewhere."""
        return 2 * _size(_left_out(np.where(nodes, -least, phi), begun)) < cut

    fills = (phi >= 0.0) & ~_outside(phi)
    if not spares(fills):
        return np.zeros_like(fills), np.zeros_like(fills)
    parts = label(fills, TOUCHING)[0]
    sizes = np.bincount(parts.ravel())[1:]
    # some are pockets, or lie in the tunnel of a handle that has been cut
    for k in np.argsort(-sizes, kind="stable")[: settings.most_parts] if len(sizes) > 1 else ():
        fewer = fills & (parts != k + 1)
        if spares(fewer):
            fills = fewer
    wider = widened(fills) & (phi >= 0.0)
    return fills, wider if spares(wider) else fills


def _cut(phi: Array, nodes: Mask, least: float) -> Array:
    """phi with the inside at nodes (mask) and next to them made outside."""
    wider = widened(nodes) & (phi < 0.0)
    return np.where(wider, np.maximum(-phi, least), phi)


def _size(nodes: Mask) -> int:
    return int(np.count_nonzero(nodes))


@njit(cache=True, inline="always")
def _queue_around(node, rank, inside, offsets, queued, waiting, first):  # type: ignore[no-untyped-def]
    """Queue the neighbours of a node that may join the inside; the lowest rank that waits, or `first`."""
    for k in range(len(offsets)):
        other = node + offsets[k]
        place = rank[other]
        if place >= 0 and not (inside[other] or queued[place]):
            queued[place] = True
            waiting[place >> 8] += 1
            first = min(first, place)
    return first


@njit(cache=True)
def _grow(nodes, rank, inside, simple, offsets):  # type: ignore[no-untyped-def]
    """Add to the inside (mask, in place) nodes next to it by simple additions, the first in `nodes` first.

    rank: of every node of the box among these, or -1.
    """
    queued = np.zeros(len(nodes), np.bool_)
    waiting = np.zeros((len(nodes) >> 8) + 2, np.int64)  # in each chunk of the queue
    first = len(nodes)
    for start in np.flatnonzero(inside):
        first = _queue_around(start, rank, inside, offsets, queued, waiting, first)
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
            first = _queue_around(node, rank, inside, offsets, queued, waiting, first)


def _grown(phi: Array, start: Mask) -> Mask:
    """Negative nodes (mask) that grow from others by simple additions, the lowest first; the border of the
    box is not grown.
    """
    offsets = STEPS @ np.array([phi.shape[1] * phi.shape[2], phi.shape[2], 1])
    inside = np.ascontiguousarray(start).ravel().copy()
    nodes = np.flatnonzero((phi.ravel() < 0.0) & ~inside)
    nodes = nodes[_ascending(phi.ravel()[nodes])]
    rank = np.full(phi.size, -1, dtype=np.int32)
    rank[nodes] = np.arange(len(nodes))
    _grow(nodes, rank, inside, _simple_patterns(), offsets)
    return inside.reshape(phi.shape)


def _ascending(values: Array) -> Ints:
    """Indices (n,) that sort values to 2^-16 of their range, those that are equal then as they come: so short
    numbers are sorted without comparing them.
    """
    least, most = values.min(initial=np.inf), values.max(initial=-np.inf)
    steps = (2.0**16 - 1.0) / (most - least) if most > least else 0.0
    return np.argsort(((values - least) * steps).astype(np.uint16), kind="stable")


def _left_out(phi: Array, begun: Mask | None = None) -> Mask:
    """Nodes inside (mask) that are not reached from the deepest one, or from those that have `begun` (mask):
    they cut handles, or are islands.
    """
    if begun is None or not begun.any():
        begun = np.zeros(phi.shape, dtype=bool)
        begun[np.unravel_index(np.argmin(phi), phi.shape)] = True
    grown = _grown(np.pad(phi, 1, constant_values=1.0), np.pad(begun, 1))
    return (phi < 0.0) & ~grown[1:-1, 1:-1, 1:-1]


def _outside(phi: Array) -> Mask:
    """Nodes outside (mask) that are reached from beyond the box; the others fill tunnels or pockets."""
    around = np.pad(np.pad(-phi, 1, constant_values=-np.inf), 1, constant_values=1.0)
    start = np.zeros(around.shape, dtype=bool)
    start[1:-1, 1:-1, 1:-1] = True
    start[2:-2, 2:-2, 2:-2] = False
    return _grown(around, start)[2:-2, 2:-2, 2:-2]
