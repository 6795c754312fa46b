"""A landmark that contradicts all others is found and not used, and none is accused where all are right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chamber import chamber, farthest_effect, measured, pose

from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.trusted_landmarks import trusted_pairs
from o3dls.geometry.similarity import apply
from o3dls.live.standing import far_landmarks
from o3dls.pipeline.pipeline import Pipeline
from o3dls.pipeline.start import start_estimate
from o3dls.registration.odd_landmark import odd_landmark
from o3dls.stages.deform import Deform
from o3dls.stages.deform_data import observed
from o3dls.stages.landmarks import Landmarks

# of an atrium, in mm: four ostia, appendage, mitral valve, a middle vein, the roof
PLACES = np.array(
    [
        [28.0, 20, 14], [26, 24, -8], [-24, 16, 14], [-22, 22, -6],
        [32, -18, 12], [8, -30, -18], [-25, 18, 4], [2, 12, 26],
    ]
)  # fmt: skip
TRIALS = 60
PRIOR = chamber(24)
FAR = np.array([20.0, -18.0, 0.0])  # 27 mm


def marked(rng: np.random.Generator, count: int, noise: float) -> tuple[Array, Array]:
    prior = PLACES[:count]
    return prior, apply(pose(20.0, 9.0), prior) + rng.normal(0.0, noise, prior.shape)


@pytest.mark.parametrize("noise", [3.0, 4.0, 5.0])
@pytest.mark.parametrize("count", range(4, 9))
def test_healthy_landmarks_are_all_kept(count: int, noise: float) -> None:
    """The noise is the rms distance of a place from where it is."""
    rng = np.random.default_rng([701_443, count])
    for _ in range(TRIALS):
        assert odd_landmark(*marked(rng, count, noise / np.sqrt(3.0))) is None


@pytest.mark.parametrize(("count", "least"), [(4, 0.4), (5, 0.8), (6, 0.9), (7, 0.95), (8, 0.95)])
def test_one_that_lies_27_mm_off_is_found_and_no_other_accused(count: int, least: float) -> None:
    """Of four, it may lie off the plane of the others: any of them may be the wrong one then."""
    rng = np.random.default_rng([390_107, count])
    found = []
    for _ in range(TRIALS):
        prior, at = marked(rng, count, 1.5)
        wrong, way = int(rng.integers(count)), rng.normal(size=3)
        at[wrong] += 27.0 * way / np.linalg.norm(way)
        found.append((odd_landmark(prior, at), wrong))
    assert all(odd in (None, wrong) for odd, wrong in found)
    assert np.mean([odd == wrong for odd, wrong in found]) >= least


@pytest.mark.parametrize("count", [5, 6, 8])
def test_one_that_has_the_place_of_another_is_found(count: int) -> None:
    rng = np.random.default_rng([548_821, count])
    found = []
    for _ in range(TRIALS):
        prior, at = marked(rng, count, 1.5)
        wrong, other = (int(k) for k in rng.choice(count, 2, replace=False))
        at[wrong] = apply(pose(20.0, 9.0), prior[other]) + rng.normal(0.0, 1.5, 3)
        found.append((odd_landmark(prior, at), wrong))
    assert all(odd in (None, wrong) for odd, wrong in found)
    assert np.mean([odd == wrong for odd, wrong in found]) >= 0.6


def test_nothing_is_said_of_three_nor_of_two_exchanged_names() -> None:
    rng = np.random.default_rng(218_557)
    prior, at = marked(rng, 3, 1.0)
    assert odd_landmark(prior, at + np.eye(3) * [27.0, 0.0, 0.0]) is None
    for count in (4, 6, 8):
        prior, at = marked(rng, count, 1.5)
        at[[0, 3]] = at[[3, 0]]
        assert odd_landmark(prior, at) is None


def with_one_far(far: Array = FAR) -> Case:
    case = measured(PRIOR, pose(10.0, 5.0))
    xyz = case.points.xyz.copy()
    xyz[-1] += far
    return replace(case, points=replace(case.points, xyz=xyz))


def test_start_landmarks_and_motion_leave_it_out_and_the_run_names_it() -> None:
    case, truth = with_one_far(), pose(10.0, 5.0)
    assert trusted_pairs(case)[0] == ["LSPV", "LIPV", "RSPV"]
    start = start_estimate(case)
    assert farthest_effect(start.T_map_prior, truth, PRIOR) < 1e-6
    found = Landmarks()(case, Estimate(case.prior, np.eye(4), "start"))
    assert farthest_effect(found.T_map_prior, truth, PRIOR) < 1e-6
    assert "rigid motion from 3 landmarks" in found.status
    assert "the landmark RIPV is not used: it lies 27 mm from where the others" in found.status
    assert found.facts["landmarks"]["RIPV"]["error"] == pytest.approx(26.9, abs=0.1)
    assert len(observed(case, Deform()).marks_map) == 3
    run = Pipeline([Landmarks(weights={"RIPV": 2.0})], folds=0).run(case)
    (said,) = {one.sentence for one in run.estimates["landmarks"].warnings if one.code == "landmark-not-used"}
    assert said.startswith("the landmark RIPV is not used: it lies 27 mm")
    assert far_landmarks(case) == ["RIPV lies 26.9 mm from where the others put it: was it marked there?"]


def test_of_a_template_and_of_a_healthy_case_all_are_used() -> None:
    for case in (replace(with_one_far(), prior_of="template"), with_one_far(np.array([1.0, 2.0, -2.0]))):
        assert len(trusted_pairs(case)[0]) == 4
        assert "fit of 4 landmarks" in start_estimate(case).status
