"""Error on points that a fit has not seen: spatial blocks of the case's own points, the whole pipeline
refitted without each.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ..arrays import Array, Ints
from ..case import Case
from ..errors import O3dlsError
from ..estimate import Estimate
from ..evaluation.distances import distances

BLOCKS_PER_FOLD = 3
FEWEST_IN_BLOCK = 5
log = logging.getLogger("o3dls")

Fit = Callable[[Case], Mapping[str, Estimate]]


def cross_validate(fit: Fit, case: Case, folds: int) -> dict[str, Array]:
    """Distances (k,) of the case's eam points to the estimates fitted without their block, by estimate, in
    file order; without the offset of a part of the map where the fold's last estimate took one out.
    """
    rows = np.flatnonzero(case.points.type == "eam")
    of = fold_of(case.points.xyz[rows], folds)
    left_out: dict[str, Array] = {}
    for fold in range(folds):
        log.info("fold %d of %d: %d points left out", fold + 1, folds, (of == fold).sum())
        away = rows[of == fold]
        try:
            estimates = fit(without(case, away))
        except O3dlsError as error:
            where = f"fold {fold + 1} of {folds} of the cross-validation"
            raise type(error)(
                f"in {where}, with {len(away)} points left out: {error}; folds = 0 leaves it away"
            ) from error
        last = list(estimates.values())[-1]
        left = last.corrected(case).points.xyz[away]
        for name, estimate in estimates.items():
            gaps = left_out.setdefault(name, np.zeros(len(rows)))
            gaps[of == fold] = distances(left, estimate.surface)
    return left_out


def too_many(case: Case, folds: int) -> list[str]:
    """A sentence where the case has fewer points than folds."""
    points = int((case.points.type == "eam").sum())
    return (
        [f"folds = {folds}: {points} points of type eam are there: must be at most {points}, or 0 for none"]
        if folds > points
        else []
    )


def without(case: Case, rows: Ints) -> Case:
    """The case without some of its points, and without truth: its rows would no longer fit."""
    keep = np.ones(len(case.points), dtype=bool)
    keep[rows] = False
    return replace(case, points=case.points.select(keep), truth=None)


def fold_of(points: Array, folds: int) -> Ints:
    """Fold (n,) in 0..folds-1 of each point: a fold is made of a few compact blocks, so that a point's
    neighbours leave with it.

    Single points would be too easy to tell from their neighbours; one big block per fold would be too hard,
    as it unmaps a whole wall.
    """
    count = max(folds, min(BLOCKS_PER_FOLD * folds, len(points) // FEWEST_IN_BLOCK))
    fold = np.zeros(len(points), dtype=np.int64)
    for k, rows in enumerate(blocks(points, np.arange(len(points)), count)):
        fold[rows] = k % folds
    return fold


def blocks(points: Array, rows: Ints, count: int) -> list[Ints]:
    """The rows in `count` compact blocks of equal size, by cutting across the direction of largest spread
    again and again.
    """
    if count == 1:
        return [rows]
    centred = points[rows] - points[rows].mean(axis=0)
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    order = rows[np.argsort(centred @ direction, kind="stable")]
    cut = round(len(rows) * (count // 2) / count)
    return blocks(points, order[:cut], count // 2) + blocks(points, order[cut:], count - count // 2)
