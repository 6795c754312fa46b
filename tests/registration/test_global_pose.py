"""Laws of the global search: any rotation is found, symmetry lowers the confidence, a mirror image is
refused.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from chamber import chamber, farthest_effect, measured, outline_without_symmetry, pose
from tiny import sphere

from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.geometry.surface import Surface
from o3dls.pipeline.file import default_pipeline
from o3dls.pipeline.pipeline import Pipeline
from o3dls.registration import global_pose as search_module
from o3dls.registration.global_pose import Candidate, angle_of, candidates, confidence
from o3dls.registration.lattice import sample, signed_lattice
from o3dls.registration.match import SurfaceMatcher
from o3dls.registration.search import even_rotations, thinned
from o3dls.stages.global_pose import GlobalPose
from o3dls.stages.icp import ICP
from o3dls.stages.pose_checks import better_pose

PRIOR = chamber(24)
RIGHT = np.radians(10.0)


def run(case: Case, **parameters: object) -> Estimate:
    return GlobalPose(**parameters)(case, Estimate(case.prior, np.eye(case.dimension + 1), "start"))


@pytest.mark.parametrize("seed", [11_071, 24_533, 38_917, 52_361])
def test_any_rotation_and_shift_is_found_and_found_surely(seed: int) -> None:
    truth = pose(float(np.random.default_rng(seed).uniform(30.0, 180.0)), 60.0, 1.04, seed=seed)
    found = run(measured(PRIOR, truth, noise=1.0, seed=seed))
    assert farthest_effect(found.T_map_prior, truth, PRIOR) < 2.0
    assert found.facts["confidence"] > 0.95
    assert found.converged


def test_a_turned_outline_is_found() -> None:
    prior = outline_without_symmetry()
    truth = pose(140.0, 40.0, 0.97, d=2)
    found = run(measured(prior, truth, noise=0.5))
    assert angle_of(found.T_map_prior, truth) < RIGHT
    assert farthest_effect(found.T_map_prior, truth, prior) < 1.5


def test_where_poses_look_alike_the_confidence_is_low_and_the_status_says_so() -> None:
    found = run(measured(sphere(20.0, 20), pose(50.0, 10.0), noise=0.5))
    assert found.facts["confidence"] < 0.9
    assert not found.converged
    assert "uncertain-pose" in {warning.code for warning in found.warnings}


@pytest.mark.parametrize(("shift", "said"), [(60.0, "ICP ended 60 mm from a pose"), (1.0, "")])
def test_a_pose_that_is_only_shifted_is_another_one_where_it_is_far_off(shift: float, said: str) -> None:
    points = measured(PRIOR, np.eye(4), noise=0.5).points.of("eam").xyz
    surface = SurfaceMatcher(PRIOR)
    best = candidates(points, surface, starts=200, scale=True)[0]
    off = best.T_map_prior + shift * np.eye(4, 4, 3) * [[1.0], [0.0], [0.0], [0.0]]
    there = replace(best.alignment, T_map_prior=off, pairs=surface.match(points, off))
    found = better_pose("mm", points, surface, Candidate.of(there, surface.radius), scale=True)
    assert found[: len(said)] == said
    assert bool(found) == bool(said)


def test_a_mirrored_prior_is_refused_and_only_on_request_accepted() -> None:
    case = measured(PRIOR, pose(70.0, 20.0), noise=0.5)
    flipped = replace(case, prior=Surface(PRIOR.vertices * [-1.0, 1.0, 1.0], PRIOR.faces[:, ::-1]))
    with pytest.raises(InputError, match="mirror image of the prior"):
        run(flipped)
    assert run(flipped, hands=False).T_map_prior.shape == (4, 4)


def test_icp_on_request_refuses_a_pose_that_another_beats() -> None:
    case = measured(PRIOR, np.eye(4), noise=0.5)
    wrong = pose(150.0, 0.0)
    good, far = (Estimate(PRIOR.transformed(T), T, "start") for T in (np.eye(4), wrong))
    assert ICP(verify=True)(case, good).converged
    assert ICP()(case, far).T_map_prior.shape == (4, 4)
    with pytest.raises(InputError, match="degrees from a pose that fits the points clearly better"):
        ICP(verify=True)(case, far)
    flipped = replace(case, prior=Surface(PRIOR.vertices * [-1.0, 1.0, 1.0], PRIOR.faces[:, ::-1]))
    with pytest.raises(InputError, match="mirror image of the prior"):
        ICP(verify=True)(flipped, good)


@pytest.mark.parametrize("marked", [False, True], ids=["init alone", "landmarks"])
@pytest.mark.parametrize("angle", [5.0, 150.0])
def test_a_run_says_that_its_start_may_be_wrong_where_no_landmarks_fix_it(angle: float, marked: bool) -> None:
    case = replace(measured(PRIOR, np.eye(4), noise=0.5), init=pose(angle, 0.0))
    case = case if marked else replace(case, prior_landmarks={})
    done = Pipeline([ICP()]).run(case)
    for estimate in done.estimates.values():
        said = [
            warning
            for warning in estimate.warnings
            if (warning.code, warning.stage) == ("start-pose-doubtful", "start")
        ]
        assert len(said) == (angle > 90.0 and not marked)


def test_a_run_says_that_the_prior_may_be_mirrored(caplog: pytest.LogCaptureFixture) -> None:
    """In its result, and at once."""
    case = measured(PRIOR, np.eye(4), noise=0.5)
    flipped = replace(
        case, prior=Surface(PRIOR.vertices * [-1.0, 1.0, 1.0], PRIOR.faces[:, ::-1]), prior_landmarks={}
    )
    warning = Pipeline([ICP()]).run(flipped).estimates["icp"].warnings[0]
    assert warning.code == "start-pose-doubtful"
    assert "the points fit the mirror image" in warning.sentence
    logged = next(record.getMessage() for record in caplog.records if record.levelname == "WARNING")
    assert logged == warning.sentence


@pytest.mark.parametrize("start", ["as given", "turned", "far away", "landmarks", "init"])
def test_the_default_searches_the_pose_where_nothing_else_gives_it(start: str) -> None:
    case = replace(measured(PRIOR, np.eye(4), noise=0.5), init=None)
    moved = {"turned": pose(120.0, 30.0), "far away": pose(20.0, 2500.0)}.get(start, np.eye(4))
    if start != "landmarks":
        case = replace(case, prior_landmarks={}, init=pose(150.0, 0.0) if start == "init" else None)
    allowed = default_pipeline().allowed_by(replace(case, prior=PRIOR.transformed(moved)))
    searched = start in ("turned", "far away")
    first = "global_pose" if searched else "landmarks" if start == "landmarks" else "icp"
    assert allowed.stages[0].name == first


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many points each search of a pose is given."""
    found = list[int]()
    plain = search_module.candidates

    def recorded(points: Array, *rest: Any, **named: Any) -> Any:
        found.append(len(points))
        return plain(points, *rest, **named)

    monkeypatch.setattr(search_module, "candidates", recorded)
    return found


@pytest.mark.parametrize("angle", [0.0, 150.0])
@pytest.mark.parametrize("allowed", [True, False], ids=["default", "as it is"])
def test_the_start_is_checked_once_and_by_a_thousand_points(
    allowed: bool, angle: float, asked: list[int]
) -> None:
    """By the prior and its mirror image; twice, and with all of 20 000, it took half of a run."""
    case = replace(measured(PRIOR, np.eye(4), 3000, noise=0.5), init=None, prior_landmarks={})
    case = replace(case, prior=PRIOR.transformed(pose(angle, 0.0)))
    plan = Pipeline([ICP()], folds=0)
    plan = plan.allowed_by(case) if allowed else plan
    assert len(plan.stages) == 1 + (allowed and angle > 0.0)
    if len(plan.stages) == 1:
        said = {one.code for one in plan.judged(case)["icp"].warnings}
        assert ("start-pose-doubtful" in said) == (angle > 0.0)
    assert asked == [1000, 1000]


def test_the_start_of_another_case_is_checked_anew(asked: list[int]) -> None:
    case = replace(measured(PRIOR, np.eye(4), noise=0.5), init=None, prior_landmarks={})
    plan = Pipeline([ICP()], folds=0).allowed_by(case)
    turned = plan.judged(replace(case, prior=PRIOR.transformed(pose(150.0, 0.0))))
    assert "start-pose-doubtful" in {one.code for one in turned["icp"].warnings}
    assert len(asked) == 4


def test_a_rigid_search_keeps_the_scale() -> None:
    assert run(measured(PRIOR, pose(70.0, 20.0, 1.05)), scale=False).scale == pytest.approx(1.0)


def test_rotations_are_spread_evenly() -> None:
    rotations = even_rotations(400, 3)
    np.testing.assert_allclose(
        np.einsum("nij,nkj->nik", rotations, rotations), np.broadcast_to(np.eye(3), (400, 3, 3)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    probes = even_rotations(77, 3) @ even_rotations(5, 3)[3]
    gaps = [
        np.degrees(
            np.arccos(np.clip((np.einsum("nij,ij->n", rotations, probe).max() - 1.0) / 2.0, -1.0, 1.0))
        )
        for probe in probes
    ]
    assert max(gaps) < 30.0


def test_the_lattice_holds_the_signed_distance() -> None:
    lattice = signed_lattice(sphere(20.0, 40))
    rng = np.random.default_rng(9_463)
    for point in rng.uniform(-25.0, 25.0, (40, 3)):
        value, *gradient = sample(lattice, *point)
        assert value == pytest.approx(np.linalg.norm(point) - 20.0, abs=0.5)
        if np.linalg.norm(point) > 5.0:
            assert gradient @ point / np.linalg.norm(point) == pytest.approx(1.0, abs=0.1)
    far, *_ = sample(lattice, 100.0, 0.0, 0.0)
    assert far == pytest.approx(80.0, abs=2.0)


def test_thinning_spreads_and_confidence_is_even_between_equals() -> None:
    points = np.vstack([np.random.default_rng(3_671).normal(0.0, 0.1, (200, 3)), 10.0 * np.eye(3)])
    assert len(thinned(points, 4)) == 4
    assert np.linalg.norm(thinned(points, 4)[1:], axis=1).min() > 9.0
    costs = np.random.default_rng(5_813).uniform(size=203)
    assert confidence(costs, costs, points) == pytest.approx(0.5)
    assert confidence(costs, costs + 0.2, points) > 0.99
    assert confidence(costs + 0.2, costs, points) < 0.01
