"""Error on points that a fit has not seen: spatial blocks of the case's own points, the whole pipeline refitted without each."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from .case import Case
from .estimate import Estimate
from .evaluate import distances
from .geometry import Array, Ints

BLOCK_SEED = 275_604_113
log = logging.getLogger("o3dls")

Fit = Callable[[Case], Mapping[str, Estimate]]


def cross_validate(fit: Fit, case: Case, folds: int) -> dict[str, Array]:
    """Distances (k,) of the case's eam points to the estimates fitted without their block, by estimate, in file order."""
    rows = np.flatnonzero(case.points.type == "eam")
    block = blocks(case.points.xyz[rows], folds)
    left_out: dict[str, Array] = {}
    for fold in range(folds):
        log.info("fold %d of %d: %d points left out", fold + 1, folds, (block == fold).sum())
        away = rows[block == fold]
        for name, estimate in fit(without(case, away)).items():
            gaps = left_out.setdefault(name, np.zeros(len(rows)))
            gaps[block == fold] = distances(case.points.xyz[away], estimate.surface)
    return left_out


def without(case: Case, rows: Ints) -> Case:
    """The case without some of its points, and without truth: its rows would no longer fit."""
    keep = np.ones(len(case.points), dtype=bool)
    keep[rows] = False
    return replace(case, points=case.points.select(keep), truth=None)


def blocks(points: Array, count: int) -> Ints:
    """Label (n,) in 0..count-1 of each point: compact regions by seeded k-means, so that a point's neighbours leave with it."""
    from scipy.cluster.vq import kmeans2

    _, label = kmeans2(points, count, minit="++", rng=np.random.default_rng(BLOCK_SEED), missing="raise")
    return np.asarray(label, dtype=np.int64)
