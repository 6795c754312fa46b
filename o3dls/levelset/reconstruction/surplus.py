"""Parts of the moved prior that the wall lacks: hardly a point lies on them, and points close their mouth or
lie on nearly all other wall.

Cut off where that costs least new wall without points (a minimum cut: Greig, Porteous and Seheult 1989).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import distance_transform_edt, label
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from ...arrays import Array, Ints
from .normals import nearest
from .reconstruct import Reconstruction
from .settings import SurplusSettings

STEPS = np.vstack([np.eye(3, dtype=np.int64), -np.eye(3, dtype=np.int64)])
UNITS = 1000.0  # of capacity in the area of one node, since flows are whole numbers
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Inside:
    """The nodes of the inside on a coarse lattice (mask): their neighbours (n, 6), -1 where outside is,
    which are at the wall (n,), which are near points (n,), and which steps lead through points (n, 6).
    """

    mask: Mask
    others: Ints
    wall: Mask
    near: Mask
    covered: Mask


def without_surplus(phi: Array, found: Reconstruction, settings: SurplusSettings) -> tuple[Array, int]:
    """phi on the box of the moved prior without such parts, and how many they were."""
    stride = max(1, round(settings.cell * found.radius / found.prior.spacing))
    inside = _inside(phi, stride, found, settings)
    far = np.zeros(inside.mask.shape, dtype=bool)
    far[inside.mask] = _cut(inside, settings)
    labels, parts = label(far)
    room = (stride * found.prior.spacing / found.between) ** 2
    surplus = [k for k in range(1, parts + 1) if _surplus(labels[inside.mask] == k, inside, room, settings)]
    if not surplus:
        return phi, 0
    away = _on_fine_lattice(np.isin(labels, surplus), inside.mask, stride, phi.shape) & (phi < 0.0)
    return np.where(away, np.maximum(-phi, settings.least_outside * found.prior.spacing), phi), len(surplus)


def _inside(phi: Array, stride: int, found: Reconstruction, settings: SurplusSettings) -> _Inside:
    mask: Mask = phi[::stride, ::stride, ::stride] < 0.0
    nodes = np.argwhere(mask)
    number = np.full(np.add(mask.shape, 2), -1)
    number[1:-1, 1:-1, 1:-1][mask] = np.arange(len(nodes))
    others = np.column_stack([number[tuple((nodes + 1 + step).T)] for step in STEPS])
    places = np.asarray((nodes * stride + found.prior.low) * found.prior.spacing, dtype=np.float64)
    gap, rows = nearest(found.wall.feet, places, 1)
    near: Mask = gap[:, 0] < max(settings.reach * found.between, 1.5 * stride * found.prior.spacing)
    outward = found.wall.normals[rows[:, 0]] @ STEPS.T > settings.cosine
    wall = np.asarray((others < 0).any(axis=1))
    return _Inside(mask, others, wall, near, near[:, None] & outward)


def _surplus(mine: Mask, inside: _Inside, room: float, settings: SurplusSettings) -> bool:
    """Whether a part (n,) is not there; room: for points, at a node of the wall."""
    wall = inside.wall & mine
    mouth = mine[inside.others] & (inside.others >= 0) & ~mine[:, None]
    closed = inside.covered[mouth].mean() if mouth.any() else 1.0
    elsewhere = (inside.wall & ~inside.near & ~mine).sum() / inside.wall.sum()
    return bool(
        room * wall.sum() > settings.expected
        and (wall & inside.near).sum() < settings.supported * wall.sum()
        and (closed > settings.closed or elsewhere < settings.elsewhere)
    )


def _cut(inside: _Inside, settings: SurplusSettings) -> Mask:
    """The nodes (n,) on the far side of the minimum cut between wall with points and wall without any."""
    others, covered = inside.others, inside.covered
    count = len(others)
    source, sink = count, count + 1
    rows, step = np.nonzero(others >= 0)
    there = others[rows, step]
    through = np.where(covered[rows, step], settings.covered, 1.0)
    on, off = np.flatnonzero(inside.wall & inside.near), np.flatnonzero(inside.wall & ~inside.near)
    first = np.concatenate([rows, np.full(len(on), source), off])
    last = np.concatenate([there, on, np.full(len(off), sink)])
    capacity = np.concatenate(
        [through, np.full(len(on), settings.support), np.full(len(off), settings.unsupported)]
    )
    whole = (UNITS * capacity).astype(np.int32)
    graph = sparse.csr_array((whole, (first, last)), shape=(count + 2, count + 2))
    left = sparse.csr_array(graph - maximum_flow(graph, source, sink).flow)
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    reached = breadth_first_order(sparse.csr_array(left.T), sink, return_predecessors=False)
    far = np.zeros(count + 2, dtype=bool)
    far[reached] = True
    return np.asarray(far[:count])


def _on_fine_lattice(part: Mask, inside: Mask, stride: int, shape: tuple[int, ...]) -> Mask:
    """A part of the inside on the coarse lattice, on the fine one: of each node the closest one inside."""
    closest = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    coarse = [
        np.minimum((np.arange(n) + stride // 2) // stride, m - 1)
        for n, m in zip(shape, part.shape, strict=True)
    ]
    return np.asarray(part[tuple(closest)][np.ix_(*coarse)])
