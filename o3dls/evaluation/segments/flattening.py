"""A piece of a surface laid flat in the unit disk, one to one: two harmonic fields with positive weights,
whose values on the rim go once round the circle (Tutte 1963, Floater 2003).

Holes of the piece are filled by a vertex each, and handles are cut open along loops that lead to the rim.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.sparse.linalg import splu

from ...arrays import Array, Ints
from ...geometry.surface import Surface

LEAST, MOST = 0.5, 2.0  # of a cotangent weight: all must be positive, and slivers must not weigh all
DEEPER = 1.0  # 1/mm: by how much weights fall into a tube, which would shrink to a point without


@dataclass(frozen=True, eq=False)
class Flat:
    """A flat piece has places (m, 2) in the unit disk; faces (k, 3) of these; and `origin` (m,): which vertex
    of the surface each is, of which a cut makes two.
    """

    places: Array
    faces: Ints
    origin: Ints


def flatten(surface: Surface, faces: Ints, anchors: Sequence[tuple[Array, float]], depth: Array) -> Flat:
    """Lay connected faces (k, 3) of a surface flat. anchors: places (3,) on the rim with their angles on the
    circle, in the order of the rim or against it. depth (n,): mm from the rim into a tube, 0 where there is
    none.
    """
    corner, count = _join_corners(faces, np.zeros(0, dtype=np.int64))
    loops = _find_loops(corner)
    origin = _origin_of(corner, faces, count)
    rim = min(range(len(loops)), key=lambda k: _distance_of(surface.vertices[origin[loops[k]]], anchors))
    filled, origin, count = _fill_holes(
        corner, origin, count, [loop for k, loop in enumerate(loops) if k != rim]
    )
    if count - _count_edges(filled) + len(filled) != 1:  # a handle
        cut, joined = _join_corners(filled, _cut_handles(filled, count))
        origin, count, filled = _origin_of(cut, origin[filled], joined), joined, cut
    (loop,) = _find_loops(filled)[:1]
    at, deep = (_take_values(values, origin, filled) for values in (surface.vertices, depth[:, None]))
    places = _solve(at, filled, deep[:, 0], loop, _angles_of(at[loop], anchors))
    real = (origin[filled] >= 0).all(axis=1)
    return Flat(places, filled[real], origin)


def _half_edges(faces: Ints) -> Ints:
    """Return from where to where (3k, 2) each side of each face goes."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def _join_corners(faces: Ints, cut: Ints) -> tuple[Ints, int]:
    """Return the faces (k, 3) with vertices of their own where they meet at a point alone, or along an edge
    that is cut (keys of lower vertex times `size` plus upper), and how many vertices there are.
    """
    size = int(faces.max()) + 1
    sides = _half_edges(faces)
    key = sides.min(axis=1) * size + sides.max(axis=1)
    order = np.argsort(key, kind="stable")
    same = (key[order][1:] == key[order][:-1]) & ~np.isin(key[order][1:], cut)
    a, b = order[:-1][same], order[1:][same]  # sides of the same edge
    start = np.arange(len(sides))
    end = np.roll(start.reshape(-1, 3), -1, axis=1).ravel()
    first, second = np.concatenate([start[a], end[a]]), np.concatenate([end[b], start[b]])
    graph = sparse.coo_array((np.ones(len(first)), (first, second)), shape=(len(sides), len(sides)))
    count, label = connected_components(graph, directed=False)
    return np.asarray(label.reshape(-1, 3), dtype=np.int64), int(count)


def _origin_of(corner: Ints, faces: Ints, count: int) -> Ints:
    origin = np.empty(count, dtype=np.int64)
    origin[corner.ravel()] = faces.ravel()
    return origin


def _find_loops(faces: Ints) -> list[Ints]:
    """Return the loops of the sides of one face alone, the longest first."""
    sides = _half_edges(faces)
    size = int(faces.max()) + 1
    lonely = ~np.isin(sides[:, 0] * size + sides[:, 1], sides[:, 1] * size + sides[:, 0])
    after = dict(map(tuple, sides[lonely].tolist()))
    loops = []
    while after:
        loop = [next(iter(after))]
        while (there := after.pop(loop[-1])) != loop[0]:
            loop.append(there)
        loops.append(np.array(loop))
    return sorted(loops, key=len, reverse=True)


def _distance_of(points: Array, anchors: Sequence[tuple[Array, float]]) -> float:
    return float(sum(np.linalg.norm(points - at, axis=1).min() for at, _ in anchors))


def _fill_holes(faces: Ints, origin: Ints, count: int, loops: list[Ints]) -> tuple[Ints, Ints, int]:
    """Return the faces with a fan in each hole, and the origins, which are -1 for the middles of fans."""
    fans = [faces]
    for k, loop in enumerate(loops):
        fans.append(np.column_stack([np.roll(loop, -1), loop, np.full(len(loop), count + k)]))
    return np.concatenate(fans), np.append(origin, np.full(len(loops), -1)), count + len(loops)


def _count_edges(faces: Ints) -> int:
    return len(np.unique(np.sort(_half_edges(faces), axis=1), axis=0))


def _cut_handles(faces: Ints, count: int) -> Ints:
    """Return the keys of edges along which a surface becomes a disk: those that no tree of faces crosses,
    without those that end nowhere.
    """
    sides = _half_edges(faces)
    size = int(faces.max()) + 1
    key = sides.min(axis=1) * size + sides.max(axis=1)
    order = np.argsort(key, kind="stable")
    twice = key[order][1:] == key[order][:-1]
    a, b = order[:-1][twice] // 3, order[1:][twice] // 3
    dual = sparse.csr_array((np.ones(len(a)), (a, b)), shape=(len(faces), len(faces)))
    before = breadth_first_order(dual + dual.T, int(a[0]), directed=False)[1]
    crossed = (before[a] == b) | (before[b] == a)
    inner = np.unique(key[order][1:][twice][~crossed])
    rim = np.setdiff1d(key, key[order][1:][twice])
    while True:
        ends = np.concatenate([inner, rim])
        degree = np.bincount(np.concatenate([ends // size, ends % size]), minlength=count)
        loose = (degree[inner // size] == 1) | (degree[inner % size] == 1)
        if not loose.any():
            return inner
        inner = inner[~loose]


def _take_values(values: Array, origin: Ints, faces: Ints) -> Array:
    """Return the values (m, d) of vertices by their origin; the middle of a fan has the mean of its rim."""
    found = values[origin]
    for middle in np.flatnonzero(origin < 0):
        rim = np.unique(faces[(faces == middle).any(axis=1)])
        found[middle] = values[origin[rim[rim != middle]]].mean(axis=0)
    return found


def _angles_of(rim: Array, anchors: Sequence[tuple[Array, float]]) -> Array:
    """Return the angle (r,) of each place (r, 3) of a rim: that of the anchors where they are, by length
    between them.
    """
    length = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1) + 1e-6
    along = np.concatenate([[0.0], np.cumsum(length)])
    total = along[-1]
    found = {float(along[np.linalg.norm(rim - at, axis=1).argmin()]): angle for at, angle in anchors}
    at = np.array(sorted(found))
    angle = np.array([found[one] for one in at])
    full = 2.0 * np.pi
    step = (np.roll(angle, -1) - angle) % full
    forward = np.isclose(step.sum(), full)  # else the rim goes the other way round
    step = step if forward else step - full
    if not (
        forward or np.isclose(step.sum(), -full)
    ):  # anchors that are not in order: the first alone counts
        at, angle, step = at[:1], angle[:1], np.array([full])
    turned = angle[0] + np.concatenate([[0.0], np.cumsum(step)])
    place = np.append(at, at[0] + total)
    shifted = np.where(along[:-1] < at[0], along[:-1] + total, along[:-1])
    return np.asarray(np.interp(shifted, place, turned))


def _solve(at: Array, faces: Ints, depth: Array, loop: Ints, angles: Array) -> Array:
    """Return places (m, 2) in the unit disk, each a mean of its neighbours with positive weights."""
    count = len(at)
    weights = np.zeros((len(faces), 3))
    corners = at[faces]
    for k in range(3):
        u, v = corners[:, k - 2] - corners[:, k], corners[:, k - 1] - corners[:, k]
        across = np.linalg.norm(np.cross(u, v), axis=1)
        weights[:, k] = (u * v).sum(axis=1) / np.maximum(across, 1e-9)  # cotangent at k: of the opposite side
    first, second = np.roll(faces, -1, axis=1).ravel(), np.roll(faces, -2, axis=1).ravel()
    half = sparse.coo_array((weights.ravel(), (first, second)), shape=(count, count)).tocsr()
    both = (half + half.T).tocoo()
    i, j = both.coords
    weight = np.clip(both.data, LEAST, MOST) * np.exp(
        -0.5 * DEEPER * np.clip(depth[j] - depth[i], -20.0, 20.0)
    )
    fixed = np.zeros(count, dtype=bool)
    fixed[loop] = True
    weight = np.where(fixed[i], 0.0, weight)
    total = np.bincount(i, weight, count)
    total[fixed] = 1.0
    matrix = sparse.eye_array(count) - sparse.coo_array((weight / total[i], (i, j)), shape=(count, count))
    right = np.zeros((count, 2))
    right[loop] = np.column_stack([np.cos(angles), np.sin(angles)])
    return np.asarray(splu(matrix.tocsc()).solve(right))
