"""Laws of the ICP stage: known poses are found, the frame does not matter, roles swap, and bad input is
answered or refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chamber import chamber, farthest_effect, measured, outline_without_symmetry, pose, sampled
from pydantic import BaseModel

from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.errors import InputError, PipelineError, SolverError
from o3dls.estimate import Estimate
from o3dls.geometry.similarity import apply, scale_of
from o3dls.geometry.surface import Surface
from o3dls.stages.icp import ICP
from o3dls.stages.icp_parameters import PRESETS

METRICS = ("point_to_point", "point_to_plane", "symmetric", "generalized")
KERNELS = ("none", "huber", "cauchy", "geman_mcclure", "tukey", "welsch", "mixture")
RULES = ("threshold", "trimmed", "deviations", "mad", "reciprocal", "normal_angle")
FINE = 1e-6  # mm, tolerance of the steps where a law is checked tightly
FACETS = 0.15  # mm: pairs slide on flat triangles, so even points without noise leave this much open
PRIOR = chamber()
TRUTH = pose(8.0, 6.0, 1.05)


def at(case: Case, matrix: Array | None = None) -> Estimate:
    matrix = np.eye(case.dimension + 1) if matrix is None else matrix
    return Estimate(case.prior.transformed(matrix), matrix, "start")


def with_points(case: Case, xyz: Array) -> Case:
    return replace(case, points=Points(xyz, np.full(len(xyz), "eam")))


@pytest.mark.parametrize("scale", [False, True])
@pytest.mark.parametrize("metric", METRICS)
def test_points_without_noise_give_the_pose_back(metric: str, scale: bool) -> None:
    truth = pose(8.0, 6.0, 1.05 if scale else 1.0)
    case = measured(PRIOR, truth, 400)
    found = ICP(preset="standard", metric=metric, scale=scale, iterations=300)(case, at(case))
    assert farthest_effect(found.T_map_prior, truth, PRIOR) < 3 * FACETS
    assert scale_of(found.T_map_prior) == pytest.approx(1.05 if scale else 1.0, abs=0.005)


@pytest.mark.parametrize("kernel", KERNELS)
def test_every_kernel_finds_the_pose(kernel: str) -> None:
    case = measured(PRIOR, TRUTH)
    found = ICP(kernel=kernel)(case, at(case))
    assert found.converged
    assert farthest_effect(found.T_map_prior, TRUTH, PRIOR) < FACETS


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_finds_the_pose_and_drops_pairs(rule: str) -> None:
    case = measured(PRIOR, TRUTH, noise=0.8)
    found = ICP(
        preset="standard",
        metric="point_to_plane",
        scale=True,
        reject=rule,
        coarse=3.0,
        **{"threshold": {"threshold": 1.2}}.get(rule, {}),
    )(case, at(case))
    assert farthest_effect(found.T_map_prior, TRUTH, PRIOR) < 2.0
    assert 0.5 * 200 < found.trace[-1]["pairs"] < 200


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("prior", [PRIOR, outline_without_symmetry()], ids=["3D", "2D"])
def test_points_on_the_surface_leave_it_where_it_is(preset: str, prior: Surface) -> None:
    case = measured(prior, np.eye(prior.dimension + 1))
    found = ICP(preset=preset)(case, at(case))
    assert found.converged
    assert farthest_effect(found.T_map_prior, np.eye(prior.dimension + 1), prior) < 1e-9


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("scale", [False, True])
def test_outlines_in_the_plane(metric: str, scale: bool) -> None:
    prior = outline_without_symmetry()
    truth = pose(7.0, 4.0, 1.04 if scale else 1.0, d=2)
    case = measured(prior, truth)
    found = ICP(preset="standard", metric=metric, scale=scale, iterations=300)(case, at(case))
    assert farthest_effect(found.T_map_prior, truth, prior) < 0.5


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("prior", [PRIOR, outline_without_symmetry()], ids=["3D", "2D"])
def test_turning_shifting_and_scaling_the_whole_case_turns_the_result(preset: str, prior: Surface) -> None:
    d = prior.dimension
    factor = 1.7
    case = measured(prior, pose(6.0, 4.0, 1.03, d=d), noise=0.7)
    frame = pose(130.0, 80.0, factor, seed=40_241, d=d)
    moved = with_points(
        replace(case, prior=prior.transformed(frame)), apply(frame, case.points.of("eam").xyz)
    )
    here = ICP(preset=preset, tolerance=1e-5)(case, at(case))
    there = ICP(preset=preset, tolerance=factor * 1e-5)(moved, at(moved))
    back = np.linalg.inv(frame) @ there.T_map_prior @ frame
    assert here.iterations == there.iterations
    assert farthest_effect(back, here.T_map_prior, prior) < FINE


def test_the_inverse_pose_when_prior_and_points_change_roles() -> None:
    moved = PRIOR.transformed(TRUTH)
    there = with_points(measured(PRIOR, TRUTH), sampled(moved, 400, 18_211))
    back = with_points(replace(there, prior=moved), sampled(PRIOR, 400, 60_913))
    a, b = (ICP()(case, at(case)).T_map_prior for case in (there, back))
    assert farthest_effect(a @ b, np.eye(4), moved) < FACETS


def test_a_third_of_the_points_inside_the_cavity_moves_the_robust_pose_little() -> None:
    case = measured(PRIOR, TRUTH, 300, noise=1.0)
    xyz = case.points.of("eam").xyz.copy()
    rng = np.random.default_rng(91_237)
    centre = apply(TRUTH, PRIOR.vertices).mean(axis=0)
    far = rng.choice(300, 90, replace=False)
    inward = (centre - xyz[far]) / np.linalg.norm(centre - xyz[far], axis=1, keepdims=True)
    depth = rng.uniform(0.0, 12.0, 90)  # from the wall on
    xyz[far] += inward * depth[:, None]
    dirty = with_points(case, xyz)
    robust = ICP()(dirty, at(dirty))
    plain = ICP(preset="standard", scale=True)(dirty, at(dirty))
    assert farthest_effect(robust.T_map_prior, TRUTH, PRIOR) < 1.5
    assert farthest_effect(robust.T_map_prior, TRUTH, PRIOR) < 0.5 * farthest_effect(
        plain.T_map_prior, TRUTH, PRIOR
    )
    assert robust.weights is not None
    assert robust.weights[far[depth > 3.0]].mean() < 0.1
    # a third of outliers makes every point a little suspect
    assert np.delete(robust.weights, far).mean() > 0.8
    assert robust.facts["outlier_fraction"] == pytest.approx(0.3, abs=0.1)
    assert robust.sigma == pytest.approx(1.0, abs=0.2)


def test_points_on_one_vein_leave_the_rest_where_it_was_and_say_so() -> None:
    case = measured(PRIOR, np.eye(4))
    vein = PRIOR.vertices[PRIOR.vertices @ np.array([0.80, 0.35, 0.48]) > 24.0]
    only = with_points(case, vein + np.random.default_rng(11_953).normal(0.0, 0.7, vein.shape))
    found = ICP()(only, at(only))
    loose = ICP(freeze=None)(only, at(only))
    weak = [one.sentence for one in found.warnings if one.code == "weak-direction"]
    assert any("do not determine" in one for one in weak)
    assert all("it matters if you use this pose itself" in one for one in weak)
    drift = [farthest_effect(estimate.T_map_prior, np.eye(4), PRIOR) for estimate in (found, loose)]
    assert drift[0] < 3.0
    assert drift[0] < 0.3 * drift[1]


def test_points_in_one_place_and_too_few_points_are_refused() -> None:
    case = measured(PRIOR, TRUTH)
    for xyz in (np.tile([[3.0, 4.0, 5.0]], (40, 1)), sampled(PRIOR, 6, 77_813)):
        bad = with_points(case, xyz)
        with pytest.raises(InputError, match="a pose needs 7 or more"):
            ICP()(bad, at(bad))


def test_rules_that_keep_nothing_are_refused() -> None:
    case = measured(PRIOR, pose(0.0, 30.0))
    with pytest.raises(SolverError, match="keep 0 of 200 pairs"):
        ICP(preset="standard", reject="threshold", threshold=1e-3, anneal=0)(case, at(case))


def test_scale_cannot_collapse_nor_leave_its_bounds() -> None:
    case = measured(PRIOR, pose(0.0, 0.0, 1.3))
    for metric in ("point_to_point", "point_to_plane"):
        found = ICP(metric=metric, kernel="none", scale_max=1.1, iterations=200)(case, at(case))
        assert found.scale == pytest.approx(1.1, abs=1e-3)
        stiff = ICP(metric=metric, kernel="none", scale_sd=1e-4, strain_sd=None)(case, at(case))
        assert stiff.scale == pytest.approx(1.0, abs=0.02)
    # a clump that a free scale would shrink the prior onto
    inside = with_points(case, 0.2 * sampled(PRIOR, 60, 15_551))
    assert ICP(scale_min=0.8)(inside, at(inside)).scale >= 0.8 - 1e-9
    # so small a one is one place
    inside = with_points(case, 0.02 * sampled(PRIOR, 60, 15_551))
    with pytest.raises(InputError, match="60 eam points in 1 different places"):
        ICP()(inside, at(inside))


def test_the_trace_has_every_iteration_and_a_run_cut_short_says_so() -> None:
    case = measured(PRIOR, TRUTH, noise=1.0)
    full = ICP(preset="modified")(case, at(case))
    cut = ICP(preset="modified", iterations=3)(case, at(case))
    assert len(full.trace) == full.iterations
    assert {"pairs", "rms", "step"} <= set(full.trace[0])
    assert full.trace[:3] == cut.trace
    assert not cut.converged
    assert cut.status.startswith("stopped after 3 iterations")
    assert full.trace[-1]["rms"] < full.trace[0]["rms"]


def test_equal_inputs_give_equal_results_and_stay_unchanged() -> None:
    case = measured(PRIOR, TRUTH, noise=1.0)
    stage = ICP()
    before = case.points.xyz.copy()
    a, b = stage(case, at(case)), stage(case, at(case))
    np.testing.assert_array_equal(a.T_map_prior, b.T_map_prior)
    np.testing.assert_array_equal(case.points.xyz, before)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"keep": 0.5}, "icp.keep = 0.5: has no effect unless reject names 'trimmed'"),
        ({"kernel_width": 2.0}, "icp.kernel_width = 2.0 robust sd: has no effect with kernel 'mixture'"),
        ({"metric": "point_to_point", "freeze": 0.1}, "has no effect with metric 'point_to_point'"),
        ({"metrc": "symmetric"}, "did you mean 'metric'"),
        ({"preset": "robst"}, "did you mean 'robust'"),
        ({"tolerance": -1.0}, "must be a number within"),
        ({"coarse": 1e308}, r"must be a number within \[1, 100\]"),
        ({"scale_sd": 1e-300}, "must be a number within"),
        ({"strain_sd": 1e-300}, "must be a number within"),
        ({"freeze": 1e-300}, "must be a number within"),
        ({"engine": "open3d"}, "must be one of none, huber"),
        ({"engine": "open3d", "preset": "standard", "metric": "symmetric", "scale": True}, "is rigid"),
    ],
)
def test_mistakes_are_sentences(given: dict[str, object], sentence: str) -> None:
    with pytest.raises(PipelineError, match=sentence):
        ICP(**given)


def test_a_preset_fills_what_is_not_given_and_the_record_makes_the_same_stage() -> None:
    assert ICP().kernel == "mixture"
    assert ICP(preset="robust") == ICP()
    assert ICP(strain_sd="none", freeze="none") == ICP(strain_sd=None, freeze=None)
    assert ICP(reject="trimmed", keep=0.85).reject == ("trimmed",)
    for stage in (
        ICP(),
        ICP(preset="modified"),
        ICP(metric="point_to_point"),
        ICP(reject=["mad", "trimmed"], mad=2.0),
    ):
        record = {key: value for key, value in stage.record().items() if key != "use"}
        assert type(stage)(**record) == stage
        assert isinstance(stage, BaseModel)
