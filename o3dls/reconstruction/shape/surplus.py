"""Parts of a moved template that the wall lacks: hardly a point lies on them, and points close their mouth or
lie on nearly all other wall, evenly. A template's veins are another person's, so that they may be absent; a
patient's own are there, whether a catheter was in them or not, and are not asked about.

Cut off where that costs least new wall without points (a minimum cut: Greig, Porteous and Seheult 1989).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.ndimage import distance_transform_edt, label
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from ...arrays import Array, Ints, Mask
from ...geometry.surface import Surface
from ..field.equations import Oriented
from ..field.moved_prior import MovedPrior
from ..neighbours import nearest
from ..shape_settings import SurplusSettings

STEPS = np.vstack([np.eye(3, dtype=np.int64), -np.eye(3, dtype=np.int64)])
UNITS = 1000.0  # of capacity in the area of one node, since flows are whole numbers


@dataclass(frozen=True, eq=False)
class _Inside:
    """The nodes of the inside are given on a coarse lattice (mask): their neighbours (n, 6), -1 where outside
    is, which are at the wall (n,), which are within reach of points (n,), and which steps lead through points
    (n, 6).
    """

    mask: Mask
    others: Ints
    wall: Mask
    near: Mask
    covered: Mask
    reach: float


def surplus(
    phi: Array,
    wall: Oriented,
    prior: MovedPrior,
    radius: float,
    between: float,
    settings: SurplusSettings,
) -> tuple[Mask, float]:
    """Find the parts of the inside of phi that the map lacks, as a mask of nodes, and how many points they
    had room for: the nats by which the map is likelier without them.
    """
    even = evenness(wall.feet, prior.surface, settings) < settings.even
    stride = max(1, round(settings.cell * radius / prior.spacing))
    inside = _describe_inside(phi, stride, wall, prior, between, settings)
    room = len(wall.feet) / max((inside.wall & inside.near).sum(), 1)
    parts = _find_bare_parts(inside, room, settings)
    other = inside.wall & ~inside.near & ~_unite_parts(parts, inside)
    by_chance = np.exp(-np.pi * (inside.reach / between) ** 2)
    fringe = min(settings.fringe * inside.reach / radius, settings.elsewhere)
    whole = other.sum() < (by_chance + fringe) * inside.wall.sum()
    if (inside.wall & _unite_parts(parts, inside)).sum() > settings.most * inside.wall.sum():
        parts = []  # no heart lacks so much of another: more likely the catheter was never there
    elif not (whole and even):
        parts = [part for part in parts if _closed_share(part, inside) > settings.closed]
    away = np.zeros(inside.mask.shape, dtype=bool)
    away[inside.mask] = _unite_parts(parts, inside)
    mask = _on_fine_lattice(away, inside.mask, stride, phi.shape) & (phi < 0.0)
    return mask, room * float((inside.wall & _unite_parts(parts, inside)).sum())


def _find_bare_parts(inside: _Inside, room: float, settings: SurplusSettings) -> list[Mask]:
    """Find the parts (n,) that lack points, cut off by a minimum cut."""
    bare = (inside.wall & ~inside.near).sum()
    # even all of it in one part would not be enough
    if room * bare <= (1.0 - settings.supported) * settings.expected:
        return []
    far = np.zeros(inside.mask.shape, dtype=bool)
    far[inside.mask] = _cut_minimally(inside, settings)
    labels, count = label(far)
    parts = [labels[inside.mask] == k for k in range(1, count + 1)]
    return [
        part
        for part in parts
        if _lacks_points(part, inside, room, settings) and not _severs_wall(part, inside, room, settings)
    ]


def evenness(points: Array, surface: Surface, settings: SurplusSettings) -> float:
    """Return the mean squared distance of a wall from the nearest of points (n, 3) on it, where any is near,
    over that of points spread at random with one density: about 1 for a map that is even, more where it
    clusters.
    """
    corners = surface.vertices[surface.faces]
    feet = surface.closest_point.query(points)[2]
    squared = nearest(feet, corners.mean(axis=1), 1)[0][:, 0] ** 2
    areas = surface.face_areas
    mapped = np.ones(len(areas), dtype=bool)
    # twice, since faces without points are no part of the wall that points are spread over
    for _ in range(2):
        mapped = squared < settings.reach**2 * areas[mapped].sum() / len(feet)
    return float(np.pi * (areas * squared)[mapped].sum() / areas[mapped].sum() ** 2 * len(feet))


def _describe_inside(
    phi: Array, stride: int, points: Oriented, prior: MovedPrior, between: float, settings: SurplusSettings
) -> _Inside:
    mask: Mask = phi[::stride, ::stride, ::stride] < 0.0
    nodes = np.argwhere(mask)
    number = np.full(np.add(mask.shape, 2), -1)
    number[1:-1, 1:-1, 1:-1][mask] = np.arange(len(nodes))
    others = np.column_stack([number[tuple((nodes + 1 + step).T)] for step in STEPS])
    places = np.asarray((nodes * stride + prior.low) * prior.spacing, dtype=np.float64)
    gap, rows = nearest(points.feet, places, 1)
    reach = max(settings.reach * between, 1.5 * stride * prior.spacing)
    near: Mask = gap[:, 0] < reach
    outward = points.normals[rows[:, 0]] @ STEPS.T > settings.cosine
    wall = np.asarray((others < 0).any(axis=1))
    return _Inside(mask, others, wall, near, near[:, None] & outward, reach)


def _unite_parts(parts: list[Mask], inside: _Inside) -> Mask:
    none = np.zeros(len(inside.wall), dtype=bool)
    return np.asarray(np.any([none, *parts], axis=0))


def _lacks_points(mine: Mask, inside: _Inside, room: float, settings: SurplusSettings) -> bool:
    """Return whether a part (n,) has room for points, `room` at a node of the wall, and hardly one lies on
    it.
    """
    wall = inside.wall & mine
    bare = (wall & inside.near).sum() < settings.supported * wall.sum()
    return bool(bare and room * wall.sum() > settings.expected)


def _severs_wall(mine: Mask, inside: _Inside, room: float, settings: SurplusSettings) -> bool:
    """Say whether a part (n,) leads to wall with points, so that it must be there; `room`: points at a
    node.
    """
    left = np.zeros(inside.mask.shape, dtype=bool)
    whole = label(inside.mask)[0][inside.mask]
    left[inside.mask] = ~mine & (whole == whole[mine][0])
    pieces = label(left)[0][inside.mask]
    near = np.bincount(pieces[inside.wall & inside.near & (pieces > 0)])
    return bool((room * near >= settings.severed).sum() > 1)


def _closed_share(mine: Mask, inside: _Inside) -> float:
    """Return the share of the mouth of a part (n,) that points close."""
    mouth = mine[inside.others] & (inside.others >= 0) & ~mine[:, None]
    return float(inside.covered[mouth].mean()) if mouth.any() else 1.0


def _cut_minimally(inside: _Inside, settings: SurplusSettings) -> Mask:
    """Return the nodes (n,) on the far side of the minimum cut between wall with points and wall
    without any.
    """
    others, covered = inside.others, inside.covered
    count = len(others)
    source, sink = count, count + 1
    rows, step = np.nonzero(others >= 0)
    there = others[rows, step]
    through = np.where(covered[rows, step], settings.covered, 1.0)
    on, off = np.flatnonzero(inside.wall & inside.near), np.flatnonzero(inside.wall & ~inside.near)
    first = np.concatenate([rows, np.full(len(on), source), off])
    last = np.concatenate([there, on, np.full(len(off), sink)])
    capacity = np.concatenate([through, np.full(len(on), settings.support), np.ones(len(off))])
    whole = (UNITS * capacity).astype(np.int32)
    # the flow is sought backwards: from where little can flow it takes a fifth of the time
    graph = sparse.csr_array((whole, (last, first)), shape=(count + 2, count + 2))
    left = sparse.csr_array(graph - maximum_flow(graph, sink, source).flow)
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    far = np.zeros(count + 2, dtype=bool)
    far[breadth_first_order(left, sink, return_predecessors=False)] = True
    return np.asarray(far[:count])


def _on_fine_lattice(part: Mask, inside: Mask, stride: int, shape: tuple[int, ...]) -> Mask:
    """Return a part of the inside on the coarse lattice, on the fine one: of each node the closest one
    inside.
    """
    closest = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    coarse = [
        np.minimum((np.arange(n) + stride // 2) // stride, m - 1)
        for n, m in zip(shape, part.shape, strict=True)
    ]
    return np.asarray(part[tuple(closest)][np.ix_(*coarse)])
