"""Crowds of floating points: found where most neighbours float, and told from a sheet by a fit."""

from __future__ import annotations

import numpy as np
import pytest

from data_synth.atrium import atrium
from data_synth.faulty_maps import crowded, folded
from o3dls.case import Case
from o3dls.evaluation.distances import distances
from o3dls.noise.crowds import carried_factors, possible_crowds
from o3dls.noise.settings import CrowdSettings
from o3dls.pipeline.file import default_pipeline

SEED = 4  # of a phantom whose free side has a quarter of the points
SETTINGS = CrowdSettings()


def _plane(rng: np.random.Generator, count: int) -> np.ndarray:
    return np.column_stack([rng.uniform(0.0, 50.0, (count, 2)), np.zeros(count)])


def test_a_place_where_most_float_is_a_crowd_and_outliers_everywhere_are_none() -> None:
    rng = np.random.default_rng(SEED)
    points = _plane(rng, 600)
    within = np.linalg.norm(points[:, :2] - 25.0, axis=1) < 9.0
    scattered = np.where(rng.uniform(size=600) < 0.1, 0.0, 1.0)
    assert possible_crowds(points, scattered, SETTINGS) == []
    found = possible_crowds(points, np.where(within, 0.1, 1.0), SETTINGS)
    assert len(found) == len(SETTINGS.shares)
    assert all(crowd[within].mean() > 0.9 for crowd in found)
    assert all(crowd[~within].mean() < 0.2 for crowd in found)
    assert [crowd.sum() for crowd in found] == sorted(crowd.sum() for crowd in found)


def test_a_crowd_is_neither_a_few_points_nor_most_of_the_map() -> None:
    points = _plane(np.random.default_rng(SEED), 600)
    away = np.linalg.norm(points[:, :2] - 25.0, axis=1)
    assert possible_crowds(points, np.where(away < 1.5, 0.0, 1.0), SETTINGS) == []
    assert possible_crowds(points, np.where(away < 24.0, 0.0, 1.0), SETTINGS) == []
    assert possible_crowds(points[:8], np.zeros(8), SETTINGS) == []


def test_factors_are_those_of_the_nearest_known_point() -> None:
    known = np.array([[0.0, 0.0], [10.0, 0.0]])
    at = np.array([[9.0, 1.0], [1.0, -2.0]])
    assert carried_factors(at, known, np.array([1.0, 7.0])).tolist() == [7.0, 1.0]


@pytest.fixture(scope="module")
def good() -> Case:
    return atrium(SEED, points=1000, noise=1.0, outliers=0.0)


def _fit(case: Case):  # type: ignore[no-untyped-def]
    plan = default_pipeline().allowed_by(case)
    return plan.fit(case)["deform"]


def _errors_on_the_side(case: Case, good: Case, surface) -> float:  # type: ignore[no-untyped-def]
    assert case.truth is not None
    assert case.truth.surface is not None
    rows = np.flatnonzero((case.points.xyz != good.points.xyz).any(axis=1))
    at = case.truth.surface.closest_point.query(good.points.xyz[rows])[2]
    return float(distances(at, surface).mean())


def test_a_fold_of_the_wall_is_followed_and_as_many_floating_points_are_not(good: Case) -> None:
    fold = folded(np.random.default_rng(SEED), good)
    crowd = crowded(np.random.default_rng(SEED), good)
    followed, left = _fit(fold), _fit(crowd)
    assert "crowd_points" not in followed.facts
    assert left.facts["crowd_points"] > 50
    assert [w.code for w in left.warnings].count("floating-crowd") == 1
    assert "floating-crowd" not in [w.code for w in followed.warnings]
    assert _errors_on_the_side(crowd, good, left.surface) < 1.5  # 9 mm deep in the mean


def test_what_is_known_of_a_crowd_stays_when_points_are_added(good: Case) -> None:
    from dataclasses import replace

    from o3dls import Deform

    crowd = crowded(np.random.default_rng(SEED), good)
    new = np.flatnonzero(crowd.points.type == "eam")[-5:]
    rows = np.concatenate([np.setdiff1d(np.arange(len(crowd.points)), new), new])
    crowd = replace(crowd, points=crowd.points.select(rows))
    before = replace(crowd, points=crowd.points.select(np.arange(len(rows) - 5)))
    stage = Deform()
    start = default_pipeline().allowed_by(before).fit(before)["icp"]
    found = stage(before.visible(stage.fits), start)
    later = stage.update(crowd.visible(stage.fits), found)
    assert later.facts["crowd_points"] == found.facts["crowd_points"]
    assert distances(later.surface.vertices, found.surface).mean() < 0.1
