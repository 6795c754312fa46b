"""The wall as a graph: lengths of edges, ways along them, and how far each vertex lies out in a tube."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra, maximum_flow
from scipy.spatial import cKDTree

from ..arrays import TINY, Array, Ints, Mask
from ..geometry.inner_balls import depth_in_tubes
from ..geometry.surface import Surface

PER_MM = 1000.0  # costs of cuts are whole numbers, of thousandths of a millimetre
OUTWARD = 0.1  # how much a bend outward counts, to one inward
SAMPLE = 1500  # vertices, 3 mm apart on an atrium, that tell how deep in a tube their neighbours lie


@lru_cache(maxsize=4)  # openings and the tubes beyond them are of the same surface
def measure_depths(surface: Surface) -> Array:
    """Return how far (n,) each vertex lies out of the chamber in a tube, mm; that of the next of a sample."""
    some = np.arange(0, len(surface.vertices), max(1, len(surface.vertices) // SAMPLE))
    at = surface.vertices[some]
    depth = depth_in_tubes(at, surface.vertex_normals[some], surface.vertices)
    return np.asarray(depth[cKDTree(at).query(surface.vertices)[1]])


def measure_edges(surface: Surface) -> sparse.coo_array:
    """Return the lengths of the edges of a surface, each once."""
    n = len(surface.vertices)
    a = surface.faces.ravel()
    b = np.roll(surface.faces, -1, axis=1).ravel()
    ends = np.divmod(sort_once(np.minimum(a, b) * n + np.maximum(a, b)), n)
    length = np.linalg.norm(surface.vertices[ends[0]] - surface.vertices[ends[1]], axis=1)
    return sparse.coo_array((length, ends), shape=(n, n))


def sort_once(keys: Ints) -> Ints:
    """Return the different ones of whole numbers (k,) in order, five times faster than `numpy.unique`."""
    found = np.sort(keys)
    return found[np.diff(found, prepend=found[:1] - 1) > 0]


def keep_edges(edges: sparse.coo_array, mask: Mask) -> sparse.csr_array:
    """Return the edges between vertices of a mask."""
    first, second = edges.coords
    kept = mask[first] & mask[second]
    return sparse.csr_array((edges.data[kept], (first[kept], second[kept])), shape=edges.shape)


def measure_way(edges: sparse.coo_array, begin: Mask, mask: Mask) -> Array:
    """Return the length (n,) of the shortest way along the surface within a mask from where it begins; inf
    where there is none.
    """
    if not begin.any():
        return np.full(len(mask), np.inf)
    graph = keep_edges(edges, mask | begin)
    return np.asarray(dijkstra(graph, directed=False, indices=np.flatnonzero(begin), min_only=True))


def label_pieces(edges: sparse.coo_array, mask: Mask) -> Ints:
    """Return the number (n,) of the connected piece of a mask that each vertex belongs to, the largest first;
    -1 outside the mask.
    """
    part = connected_components(keep_edges(edges, mask), directed=False)[1]
    names, counts = np.unique(part[mask], return_counts=True)
    order = np.full(len(mask), -1)
    order[names[np.argsort(-counts, kind="stable")]] = np.arange(len(names))
    return np.asarray(np.where(mask, order[part], -1))


def cut_apart(surface: Surface, mask: Mask, begin: Mask, end: Mask) -> tuple[Mask, float]:
    """Return the vertices (n,) of a mask on the side of its part `begin`, of the cheapest cut through the
    wall between that and its part `end`, which is short and goes along creases; and what the cut costs over
    its length: 1 on a flat wall, the less the sharper the crease.

    A minimum cut (Ford and Fulkerson 1956). It costs the length of the lines from the middles of the edges
    that it crosses to those of the faces beside them, and less where the wall bends inward (Katz and Tal
    2003).
    """
    n, faces = len(surface.vertices), surface.faces[mask[surface.faces].all(axis=1)]
    a, b = (np.concatenate([faces[:, k - shift] for k in range(3)]) for shift in (0, 1))
    middle = np.tile(surface.vertices[faces].mean(axis=1), (3, 1))
    length = np.linalg.norm(middle - 0.5 * (surface.vertices[a] + surface.vertices[b]), axis=1)
    turn = surface.vertex_normals[b] - surface.vertex_normals[a]
    inward = ((surface.vertices[b] - surface.vertices[a]) * turn).sum(axis=1) < 0.0
    bend = np.where(inward, 1.0, OUTWARD) * (turn**2).sum(axis=1)
    cost = length / (1.0 + bend / bend.mean())
    source, sink, never = n, n + 1, cost.sum()
    first, last = np.flatnonzero(begin & mask), np.flatnonzero(end & mask)
    rows = np.concatenate([a, b, np.full(len(first), source), last])
    columns = np.concatenate([b, a, first, np.full(len(last), sink)])
    costs = np.concatenate([cost, cost, np.full(len(first) + len(last), never)])
    graph = sparse.csr_array((costs * PER_MM, (rows, columns)), shape=(n + 2, n + 2)).astype(np.int32)
    left = graph - maximum_flow(graph, source, sink).flow
    found = np.zeros(n + 2, dtype=bool)
    found[breadth_first_order(left > 0, source, return_predecessors=False)] = True
    side = np.asarray(found[:n] & mask)
    crossed = side[a] & ~side[b]
    return side, float(cost[crossed].sum() / max(length[crossed].sum(), TINY))
