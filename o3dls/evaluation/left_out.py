"""Points that a fit has not seen: how far they lie from its surface, and how far it expected them to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Ints, Mask
from ..estimate import Estimate
from .projection import project

BLOCKS_PER_FOLD = 3
FEWEST_IN_BLOCK = 5


@dataclass(frozen=True, eq=False)
class LeftOut:
    """This holds the distance (n,) of each point from the surface of a fit without it, and the standard
    deviation (n,) that this fit predicts of that distance, by its posterior and its noise; NaN where it
    predicts none.
    """

    distance: Array
    deviation: Array

    @classmethod
    def unknown(cls, count: int) -> LeftOut:
        """Return that of so many points of which nothing is known yet."""
        return cls(np.full(count, np.nan), np.full(count, np.nan))

    def fill(self, rows: Mask, other: LeftOut) -> None:
        """Take over what is known of some of the points."""
        self.distance[rows], self.deviation[rows] = other.distance, other.deviation


def left_out_points(xyz: Array, estimate: Estimate, unit: str) -> LeftOut:
    """Return how points (n, d), which an estimate has not seen, lie to its surface."""
    wall = project(xyz, estimate.surface)
    sd = estimate.surface.fields.get(f"sd_{unit}")
    if sd is None or estimate.sigma is None:
        return LeftOut(wall.distance, np.full(len(xyz), np.nan))
    there = np.einsum("nc,nc->n", wall.weights, sd[estimate.surface.faces[wall.face]])
    return LeftOut(wall.distance, np.hypot(there, estimate.sigma))


def fold_of(points: Array, folds: int) -> Ints:
    """Return the fold (n,) in 0..folds-1 of each point: a fold is made of a few compact blocks, so that a
    point's neighbours leave with it.

    Single points would be too easy to tell from their neighbours; one big block per fold would be too hard,
    as it unmaps a whole wall.
    """
    return np.asarray(block_of(points, folds) % folds)


def block_of(points: Array, folds: int) -> Ints:
    """Return the block (n,) of each point that leaves with its neighbours, and errs with them; `folds` blocks
    on from a block is one of the same fold.
    """
    count = max(folds, min(BLOCKS_PER_FOLD * folds, len(points) // FEWEST_IN_BLOCK))
    block = np.zeros(len(points), dtype=np.int64)
    for k, rows in enumerate(blocks(points, np.arange(len(points)), count)):
        block[rows] = k
    return block


def blocks(points: Array, rows: Ints, count: int) -> list[Ints]:
    """Return the rows in `count` compact blocks of equal size, by cutting across the direction of largest
    spread again and again.
    """
    if count == 1:
        return [rows]
    centred = points[rows] - points[rows].mean(axis=0)
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    order = rows[np.argsort(centred @ direction, kind="stable")]
    cut = round(len(rows) * (count // 2) / count)
    return blocks(points, order[:cut], count // 2) + blocks(points, order[cut:], count - count // 2)
