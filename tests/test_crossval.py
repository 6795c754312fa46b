"""Cross-validation: each point is left out once, with its neighbours, and refitted without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tiny import Nudge, Spy, ball_case

from o3dls.crossval import blocks, cross_validate, without
from o3dls.evaluate import distances
from o3dls.pipeline import Pipeline

FOLDS = 4


def test_blocks_are_compact_cover_everything_and_repeat() -> None:
    points = ball_case().points.of("eam").xyz
    label = blocks(points, FOLDS)
    assert sorted(set(label.tolist())) == list(range(FOLDS))
    np.testing.assert_array_equal(label, blocks(points, FOLDS))
    centres = np.array([points[label == k].mean(axis=0) for k in range(FOLDS)])
    own = np.linalg.norm(points - centres[label], axis=1)
    assert (own[:, None] <= np.linalg.norm(points[:, None] - centres, axis=2) + 1e-9).mean() > 0.95


def test_every_fold_is_fitted_without_its_points_and_scored_on_them() -> None:
    case = ball_case()
    Spy.seen.clear()
    left_out = cross_validate(Pipeline([Spy(), Nudge()]).fit, case, FOLDS)
    eam = case.points.of("eam").xyz
    label = blocks(eam, FOLDS)
    assert set(left_out) == {"start", "spy", "nudge"}
    for fold, seen in enumerate(Spy.seen):
        shown = {tuple(p) for p in seen.points.of("eam").xyz}
        assert shown == {tuple(p) for p in eam[label != fold]}
        refit = Pipeline([Nudge()]).fit(without(case, np.flatnonzero(label == fold)))["nudge"]
        np.testing.assert_allclose(left_out["nudge"][label == fold], distances(eam[label == fold], refit.surface))


def test_the_whole_run_reports_it_and_zero_folds_turn_it_off() -> None:
    case = replace(ball_case(), truth=None)
    assert Pipeline([Nudge()], folds=FOLDS).run(case).scores["nudge"]["cross_validated"]["n"] == 60
    run = Pipeline([Nudge()], folds=0).run(case)
    assert "cross_validated" not in run.scores["nudge"]
    assert "left_out_nudge_mm" not in run.points.columns


@pytest.mark.parametrize("kind", ["ablation", "landmark"])
def test_only_eam_points_are_left_out(kind: str) -> None:
    case = ball_case()
    rows = np.flatnonzero(case.points.type == "eam")[:5]
    assert len(without(case, rows).points.of(kind)) == len(case.points.of(kind))
    assert without(case, rows).truth is None
