"""Tubes of an atrium: veins and the appendage, found by how far the wall lies out of the chamber.

Each local maximum of the depth has a basin, from which the depth falls to the chamber (a watershed). A basin
whose maximum stands out little over the pass to a deeper one, or whose pass lies far out as where a vein
branches, belongs to that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ...arrays import Array, Ints, Mask
from ...geometry.surface import Surface
from ..wall_graph import cut_apart, label_pieces, measure_way

MOUTH = 2.5  # mm out of the chamber: where a tube begins
SHORT = 4.0  # mm out of the chamber: what reaches less far is no tube
PROMINENT = 2.0  # mm over the pass to a deeper tube
BRANCH = 14.0  # mm out of the chamber: passes beyond are branches of one vein
DEEP = 6.0  # mm out of the chamber, or half of what the tube reaches: what lies there is surely tube
NECK = 8.0  # mm along the wall from there: wall farther off that lies shallow is a bulge of the chamber
RING = 3.0  # mm beyond the mouth: the ring of vertices that tells where the mouth is
SMOOTHING = 3  # passes of averages over neighbours, as depths are those of a sample
# of its length: what a cut costs at most along the crease where two tubes touch; across a tube it is half
CREASED = 1.0 / 3.0
APART = 10.0  # mm between the middles of two mouths of one tube, where two tubes touch each other


@dataclass(frozen=True, eq=False)
class Tube:
    """A tube has its vertices inside (n,), the middle (3,) of its mouth, and how far out it reaches in mm."""

    inside: Mask
    mouth: Array
    reach: float


def find_tubes(surface: Surface, edges: sparse.coo_array, depth: Array) -> list[Tube]:
    """Return the tubes of a surface, the longest first. depth (n,): mm out of the chamber."""
    smooth = _smooth_depth(edges, depth)
    label = _watershed(edges, smooth)
    found = list[Tube]()
    for one in np.unique(label):
        inside = label_pieces(edges, (label == one) & (smooth > MOUTH)) == 0
        if inside.any() and smooth[inside].max() > SHORT:
            inside &= _measure_from_deep(edges, smooth, inside) < NECK
            found += [
                _make_tube(surface, smooth, part) for part in _split_mouths(surface, edges, smooth, inside)
            ]
    return sorted(found, key=lambda tube: -tube.reach)


def _measure_from_deep(edges: sparse.coo_array, depth: Array, inside: Mask) -> Array:
    """Return the way (n,) along a tube from its deep part."""
    deep = min(DEEP, 0.5 * (MOUTH + float(depth[inside].max())))
    return measure_way(edges, inside & (depth >= deep), inside)


def _smooth_depth(edges: sparse.coo_array, depth: Array) -> Array:
    first, second = (np.concatenate(both) for both in (edges.coords, edges.coords[::-1]))
    count = 1.0 + np.bincount(first, minlength=len(depth))
    for _ in range(SMOOTHING):
        depth = (depth + np.bincount(first, depth[second], len(depth))) / count
    return depth


def _watershed(edges: sparse.coo_array, depth: Array) -> Ints:
    """Return which tube (n,), named by its deepest vertex, the way up from each vertex leads to."""
    links = sparse.csr_array(edges + edges.T)
    basin, parent = np.full(len(depth), -1), dict[int, int]()
    joined = dict[int, int]()  # which basin a basin has met, whether it belongs to that or not

    def follow(table: dict[int, int], one: int) -> int:
        while table[one] != one:
            one = table[one]
        return one

    for v in np.argsort(-depth, kind="stable"):
        around = links.indices[links.indptr[v] : links.indptr[v + 1]]
        around = around[basin[around] >= 0]
        if len(around) == 0:
            basin[v] = parent[v] = joined[v] = v
            continue
        basin[v] = basin[around[depth[around].argmax()]]
        meeting = sorted({follow(joined, int(basin[u])) for u in around}, key=lambda peak: -depth[peak])
        for peak in meeting[1:]:
            joined[peak] = meeting[0]
            if depth[peak] - depth[v] < PROMINENT or depth[v] > BRANCH:
                parent[peak] = meeting[0]
    return np.array([follow(parent, int(one)) for one in basin])


def _split_mouths(surface: Surface, edges: sparse.coo_array, depth: Array, inside: Mask) -> list[Mask]:
    """Return the parts of a tube that belong to each of its mouths: two where the tips of two tubes touch
    each other, else one. Where they touch the wall is creased; a tube whose own tip touches the chamber has
    two mouths as well, and no crease.
    """
    ring = inside & (depth < MOUTH + RING)
    piece = label_pieces(edges, ring)
    large = [k for k in range(piece.max() + 1) if (piece == k).sum() >= max(8, 0.25 * (piece == 0).sum())]
    middles = np.array([surface.vertices[piece == k].mean(axis=0) for k in large])
    if len(large) != 2 or np.linalg.norm(middles[0] - middles[1]) < APART:
        return [inside]
    first, cost = cut_apart(surface, inside, piece == large[0], piece == large[1])
    return [first, inside & ~first] if cost < CREASED else [inside]


def _make_tube(surface: Surface, depth: Array, inside: Mask) -> Tube:
    ring = inside & (depth < MOUTH + RING)
    at = surface.vertices[ring if ring.any() else inside]
    return Tube(inside, at.mean(axis=0), float(depth[inside].max()))
