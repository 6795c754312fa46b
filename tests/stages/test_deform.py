"""The stage around the fit: which points it shows, with what noise and odds, and what it says of the
result.
"""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from chamber import chamber, pose, sampled, tips
from fields import bend, body, spots
from scipy.spatial.transform import Rotation
from tiny import sphere

from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.errors import InputError, PipelineError, SolverError
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface
from o3dls.io.case_reader import read_case
from o3dls.motion.result import MotionFit
from o3dls.resources import demo_case
from o3dls.run_warning import RunWarning
from o3dls.stages.deform import Deform
from o3dls.stages.deform_checks import (
    alternatives,
    another_heart,
    captured,
    changed_volume,
    stretched,
)
from o3dls.stages.deform_data import observed
from o3dls.stages.level_set import LevelSet
from o3dls.stages.level_set_data import believed
from o3dls.stages.pose_checks import swapped_landmarks

NOISE = 0.8


def bent_case(dimension: int = 3, count: int = 150) -> tuple[Case, Array]:
    """A body whose wall points, ablation points and landmarks went along with a motion; and where its
    vertices truly went.
    """
    surface = body(dimension)
    truth = surface.vertices + bend(surface, 71_191)
    _, face, bary = spots(surface, count + 30, 52_127)
    xyz = np.einsum("nc,ncd->nd", bary, truth[surface.faces[face]])
    xyz = xyz + NOISE * np.random.default_rng(4_637).normal(size=xyz.shape)
    rows = [0, len(truth) // 3, len(truth) // 2]
    kind = np.array(["eam"] * count + ["ablation"] * 30 + ["landmark"] * 3)
    name = np.array([""] * (count + 30) + ["a", "b", "c"])
    marks = {n: surface.vertices[r] for n, r in zip("abc", rows, strict=True)}
    return Case("bent", surface, Points(np.vstack([xyz, truth[rows]]), kind, {"name": name}), marks), truth


def started(case: Case) -> Estimate:
    return Estimate(case.prior, np.eye(case.dimension + 1), "as it stands")


def with_column(case: Case, **columns: Array) -> Case:
    return replace(case, points=replace(case.points, columns={**case.points.columns, **columns}))


@pytest.mark.parametrize("dimension", [2, 3])
def test_deform_comes_nearer_to_the_truth_and_says_how_sure_it_is(dimension: int) -> None:
    case, truth = bent_case(dimension)
    found = Deform()(case, started(case))
    target = case.prior.with_vertices(truth)
    assert (
        distances(found.surface.vertices, target).mean() < 0.5 * distances(case.prior.vertices, target).mean()
    )
    assert found.converged
    assert found.status.startswith("converged")
    assert found.surface.fields["sd_mm"].shape == (len(case.prior.vertices),)
    assert (found.surface.fields["sd_mm"] > 0.0).all()
    assert found.weights is not None
    assert found.weights.shape == (150,)
    assert found.sigma == pytest.approx(NOISE, rel=0.3)
    assert found.motion is not None
    assert np.abs(found.motion(case.prior.vertices) - found.surface.vertices).max() < 0.1 * NOISE
    pose = apply(found.T_map_prior, case.prior.vertices)
    # the similarity part of the motion
    assert np.linalg.norm(pose - found.surface.vertices, axis=1).mean() < 3.0
    np.testing.assert_array_equal(case.prior.vertices, body(dimension).vertices)  # the case is never changed


def test_ablation_points_are_held_out_or_fitted_with_their_own_noise() -> None:
    case, _ = bent_case()
    assert "ablation" not in Deform().fits
    assert len(observed(case.visible(Deform().fits), Deform()).points) == 150
    stage = Deform(ablation="fit")
    data = observed(case.visible(stage.fits), stage)
    np.testing.assert_array_equal(data.group, [0] * 150 + [1] * 30)
    found = stage(case.visible(stage.fits), started(case))
    assert found.weights is not None
    assert len(found.weights) == 150  # those of the mapping points
    assert found.facts["ablation_noise"] == pytest.approx(NOISE, rel=0.5)
    assert "ablation_noise" not in Deform()(case, started(case)).facts


def test_landmarks_are_used_unless_told_otherwise() -> None:
    case, _ = bent_case()
    assert len(observed(case, Deform()).marks_prior) == 3
    assert len(observed(case, Deform(landmarks=False)).marks_prior) == 0


def test_sigma_of_single_points_is_relative_to_their_median() -> None:
    case, _ = bent_case()
    sigma = np.full(len(case.points), np.nan)
    sigma[:3] = [1.0, 2.0, 4.0]
    relative = observed(with_column(case, sigma=sigma), Deform()).relative
    np.testing.assert_allclose(relative[:4], [0.5, 1.0, 2.0, 1.0])
    sigma[7] = 0.0
    with pytest.raises(InputError, match="above 0, but point 7 has 0"):
        observed(with_column(case, sigma=sigma), Deform())


@pytest.mark.parametrize(
    ("first", "others", "said"),
    [
        (1.0, 1.3, []),
        (3.0, np.nan, [("sigma-missing", "it is taken to be the median of the others, 3 mm")]),
        (0.0013, 1.3, [("sigma-range", "from 0.0013 to 1.3: are all values in mm?")]),
    ],
)
def test_a_sigma_that_may_not_mean_what_it_says_is_warned_of(
    first: float, others: float, said: list[tuple[str, str]]
) -> None:
    case, _ = bent_case()
    sigma = np.full(len(case.points), others)
    sigma[:15] = first
    stage = Deform(ablation="fit")
    found = stage(with_column(case, sigma=sigma).visible(stage.fits), started(case)).warnings
    assert [one.code for one in found] == [code for code, _ in said]
    assert all(words in one.sentence for one, (_, words) in zip(found, said, strict=True))


def test_points_that_hardly_press_are_doubted() -> None:
    case, _ = bent_case()
    force = np.where(np.arange(len(case.points)) < 75, 0.5, 20.0)
    odds = observed(with_column(case, force=force), Deform()).odds
    assert (odds[:75] > 1.5).all()
    assert (odds[75:150] < 0.5).all()
    plain = Deform()(case, started(case)).weights
    pressed = Deform()(with_column(case, force=force), started(case)).weights
    assert plain is not None
    assert pressed is not None
    assert (pressed[:75] - plain[:75]).mean() < (pressed[75:] - plain[75:]).mean()


def test_points_alone_in_the_chamber_are_doubted_and_those_known_to_be_inside_are_not() -> None:
    case, _ = bent_case(count=1500)
    middle = case.prior.vertices.mean(axis=0)
    xyz, kind = case.points.xyz.copy(), case.points.type.copy()
    alone = np.arange(0, 1500, 150)
    xyz[alone] = middle + 0.3 * (xyz[alone] - middle)
    kind[alone[::2]] = "inside"
    data = observed(replace(case, points=replace(case.points, xyz=xyz, type=kind)), Deform())
    assert (data.outlier_odds[alone[1::2]] > 5.0).all()
    assert (data.outlier_odds[alone[::2]] == 1.0).all()
    assert np.median(data.outlier_odds) < 1.5
    few = data.at(slice(0, 300))  # a part of the points knows what the others have shown
    np.testing.assert_array_equal(few.outlier_odds, data.outlier_odds[:300])


def test_outliers_pull_where_every_point_is_believed() -> None:
    case, truth = bent_case()
    middle = case.prior.vertices.mean(axis=0)
    xyz = case.points.xyz.copy()
    xyz[:150:10] = middle + 0.6 * (xyz[:150:10] - middle)  # the catheter floats in the chamber
    case = replace(case, points=replace(case.points, xyz=xyz))
    doubted, believed = (Deform(outliers=how)(case, started(case)) for how in ("find", "none"))
    assert believed.weights is not None
    assert believed.weights.min() > 0.999
    off = [
        distances(found.surface.vertices, case.prior.with_vertices(truth)).mean()
        for found in (doubted, believed)
    ]
    assert off[0] < 0.7 * off[1]


def test_a_noisy_point_with_its_sigma_known_pulls_less() -> None:
    case, truth = bent_case()
    noisy = np.arange(0, 150, 3)
    xyz = case.points.xyz.copy()
    xyz[noisy] += 3.0 * np.random.default_rng(88_001).normal(size=(len(noisy), 3))
    sigma = np.full(len(xyz), 1.0)
    sigma[noisy] = 4.0
    worse = replace(case, points=replace(case.points, xyz=xyz))
    target = case.prior.with_vertices(truth)
    blind, told = (
        distances(Deform()(c, started(c)).surface.vertices, target).mean()
        for c in (worse, with_column(worse, sigma=sigma))
    )
    assert told < blind


def test_odds_against_motion_hold_the_shape_of_the_prior() -> None:
    case, _ = bent_case()
    held = Deform(odds=1e6)(case, started(case))
    np.testing.assert_allclose(held.surface.vertices, apply(held.T_map_prior, case.prior.vertices), atol=1e-9)
    assert "probability 0.00" in held.status


def turned_ball(marked: int, shift: float = 1.0) -> tuple[Case, Array]:
    """A ball that was turned and shifted, with so many landmarks, and where its vertices went. Its points
    know nothing of the turn.
    """
    ball = sphere(20.0, 3)
    turn = Rotation.from_rotvec([0.0, 0.06, 0.08])
    by = np.array([shift, 0.0, 0.0])
    marks = dict(
        zip("abcd"[:marked], 20.0 * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0]]), strict=False)
    )
    wall = turn.apply(sampled(ball, 60, 5_413)) + by + 0.2 * np.random.default_rng(71).normal(size=(60, 3))
    there = turn.apply(np.reshape(list(marks.values()), (-1, 3))) + by if marks else np.zeros((0, 3))
    kind = np.array(["eam"] * 60 + ["landmark"] * marked)
    name = np.array([""] * 60 + list(marks))
    return Case("ball", ball, Points(np.vstack([wall, there]), kind, {"name": name}), marks), turn.apply(
        ball.vertices
    ) + by


@pytest.mark.parametrize("odds", [0.0, 1e6])
def test_without_a_motion_the_pose_is_that_of_points_and_landmarks(odds: float) -> None:
    case, truth = turned_ball(marked=4)
    found = Deform(odds=odds)(case, started(case))
    assert found.facts["motion_probability"] < 0.1
    # 60 points with a noise of .2 know a pose to about .2 sqrt(7 / 60); a turn that is linear would swell the
    # ball
    assert np.linalg.norm(found.surface.vertices - truth, axis=1).mean() < 0.15
    assert found.sigma == pytest.approx(0.2, rel=0.25)
    assert found.motion is not None
    # between its nodes
    np.testing.assert_allclose(found.motion(case.prior.vertices), found.surface.vertices, atol=0.02)


def test_the_deviation_is_that_of_the_motion_from_where_the_surface_is_left() -> None:
    case, _ = bent_case()
    motion: Any = Deform()(case, started(case)).motion
    at, normals = case.prior.vertices[::9], case.prior.vertex_normals[::9]
    alone = similarity(np.eye(3), np.array([0.5, -1.0, 2.0]))
    left = replace(motion, probability=0.4, pose_alone=alone)
    whole = replace(motion, probability=1.0)
    apart = ((whole(at) - left(at)) * normals).sum(axis=1)
    expected = np.hypot(whole.sd(at, normals), motion.inflation * apart)
    np.testing.assert_allclose(left.sd(at, normals), expected, rtol=1e-9)


@pytest.mark.parametrize("marked", [0, 1])
def test_without_a_motion_and_landmarks_that_fix_a_pose_the_given_one_stays(marked: int) -> None:
    case, _ = turned_ball(marked, shift=0.05)
    found = Deform(odds=1e6)(case, started(case))
    np.testing.assert_allclose(found.surface.vertices, case.prior.vertices, atol=1e-9)


def test_an_update_keeps_the_pose_that_stands_for_what_is_not_shown() -> None:
    case, _ = turned_ball(marked=4)
    fitted = Deform(odds=1e6)(case, started(case))
    updated = Deform(odds=1e6).update(with_points(case, case.points.xyz[3] + 0.1), fitted)
    np.testing.assert_allclose(updated.surface.vertices, fitted.surface.vertices, atol=1e-9)


def test_several_starts_end_in_the_likelier_basin() -> None:
    case, truth = bent_case()
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])  # half a turn: no basin of the truth
    lost = Estimate(case.prior.transformed(turned), turned, "half a turn off")
    alone = Deform()(case.visible(), lost)
    several = Deform(starts="several")(case.visible(), lost)
    assert several.fit.energy <= alone.fit.energy
    missed = [np.linalg.norm(e.surface.vertices - truth, axis=1).mean() for e in (several, alone)]
    # the body's ends look alike: only its vertices tell that it was turned
    assert missed[0] < 0.2 * missed[1]


def test_a_noisy_fit_from_a_wrong_start_is_left_for_that_from_the_landmarks() -> None:
    """Noise of 3.5 mm hides from the given start that it is 60 degrees off; exact points do not need more."""
    surface = chamber()
    marks = tips(surface)
    xyz = np.vstack([sampled(surface, 100, 3, noise=3.5), np.array(list(marks.values()))])
    names = np.array([""] * 100 + list(marks))
    case = Case(
        "noisy", surface, Points(xyz, np.array(["eam"] * 100 + ["landmark"] * 4), {"name": names}), marks
    )
    turned = pose(60, 5, seed=1)
    lost = Estimate(surface.transformed(turned), turned, "60 degrees off")
    given, found = Deform(starts="given")(case, lost), Deform()(case, lost)
    missed = [np.linalg.norm(e.surface.vertices - surface.vertices, axis=1).mean() for e in (given, found)]
    assert missed[0] > 5.0
    assert missed[1] < 1.0
    kept = Deform(landmarks=False)(case, lost)  # landmarks that are not used give no start
    np.testing.assert_array_equal(
        kept.surface.vertices, Deform(landmarks=False, starts="given")(case, lost).surface.vertices
    )


def test_one_more_point_updates_an_estimate_as_a_fit_from_nothing_would() -> None:
    case, _ = bent_case()
    stage = Deform()
    eam = np.flatnonzero(case.points.type == "eam")
    before = replace(case, points=case.points.select(np.delete(np.arange(len(case.points)), eam[-1])))
    fitted = stage(before.visible(), started(case))
    updated = stage.update(case, fitted)
    afresh = stage(case.visible(), started(case))
    moved = np.linalg.norm(updated.surface.vertices - afresh.surface.vertices, axis=1).mean()
    # mm: far below the noise; amplitudes are kept where the fit from nothing tunes them again
    assert moved < 0.05
    assert updated.weights is not None
    assert len(updated.weights) == 150
    assert fitted.status.startswith("converged; ")
    assert updated.status.startswith("updated with 1 point since the full fit; noise ")
    with pytest.raises(InputError, match="fewer than"):
        stage.update(before, updated)
    with pytest.raises(InputError, match="must come from the stage 'deform'"):
        stage.update(case, started(case))


@pytest.mark.parametrize(
    "wrong", [{"vector": (1.0, 0.0)}, {"normal": (-0.5,)}, {"iterations": 14}, {"amplitude_log_sd": 0.0}]
)
def test_settings_that_mean_nothing_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(PipelineError):
        Deform(**wrong)  # type: ignore[arg-type]


def test_a_point_that_must_be_believed_is_believed_however_far_off() -> None:
    case, _ = bent_case()
    xyz = case.points.xyz.copy()
    xyz[0] = 0.0  # the middle of the body: 30 noise levels inside
    found = Deform(outliers="none")(
        replace(case, points=replace(case.points, xyz=xyz)).visible(), started(case)
    )
    assert found.weights is not None
    assert found.weights.min() > 0.99


def test_landmarks_in_one_place_are_no_start() -> None:
    case, _ = bent_case()
    one = dict.fromkeys("abc", case.prior.vertices[0])
    found = Deform(starts="several")(replace(case.visible(), prior_landmarks=one), started(case))
    assert np.isfinite(found.surface.vertices).all()


def test_several_starts_without_landmarks_say_that_there_is_but_one() -> None:
    case, _ = bent_case()
    found = Deform(starts="several")(replace(case.visible(), prior_landmarks={}), started(case))
    assert [one.code for one in found.warnings] == ["no-landmark-start"]
    assert Deform()(replace(case.visible(), prior_landmarks={}), started(case)).warnings == ()


def test_a_start_that_is_almost_as_likely_is_told_of() -> None:
    """A ball hides every turn from its points."""
    ball = sphere()
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    points = spots(ball, 80, 7_919)[0] + 0.3 * np.random.default_rng(7_920).normal(size=(80, 3))
    marks = {name: 20.0 * axis for name, axis in zip("abc", np.eye(3), strict=True)}
    xyz = np.vstack([points, np.array(list(marks.values()))])
    kind = np.array(["eam"] * 80 + ["landmark"] * 3)
    case = Case("ball", ball, Points(xyz, kind, {"name": np.array([""] * 80 + list(marks))}), marks)
    start = Estimate(ball.transformed(turned), turned, "half a turn off")
    found = Deform(starts="several", landmarks=False)(case, start)
    (warning,) = found.warnings
    assert warning.code == "alternative-start"
    assert re.search(r"\(\d\.\d nats less\) and leads to a surface \d+\.\d mm away", warning.sentence)


def with_points(case: Case, *extra: Array) -> Case:
    """The case with further mapping points behind the others."""
    points = case.points
    more = np.array(extra)
    kind = np.r_[points.type, np.full(len(more), "eam")]
    columns = {"name": np.r_[points.columns["name"], np.full(len(more), "")]}
    return replace(case, points=Points(np.vstack([points.xyz, more]), kind, columns))


def test_copies_of_a_point_are_no_new_evidence() -> None:
    case, _ = bent_case()
    plain = Deform()(case.visible(), started(case))
    copied = Deform()(
        with_points(case, *case.points.xyz[:60], *case.points.xyz[:60]).visible(), started(case)
    )
    np.testing.assert_array_equal(copied.surface.vertices, plain.surface.vertices)
    assert copied.weights is not None
    assert plain.weights is not None
    np.testing.assert_array_equal(
        copied.weights, np.r_[plain.weights, plain.weights[:60], plain.weights[:60]]
    )
    (warning,) = copied.warnings
    assert warning.code == "duplicate-points"
    assert warning.sentence.startswith("120 of 270 points repeat the place of another;")


def test_a_map_that_was_merged_with_its_rounded_copy_tells_no_more_than_once() -> None:
    """Copies .05 mm apart made the noise look like a third of what it was, and the motion follow what it no
    longer explained.
    """
    case, truth = bent_case()
    plain = Deform()(case.visible(), started(case))
    merged = with_points(case, *(case.points.xyz[:150] + 0.03))
    twice = Deform()(merged.visible(), started(case))
    target = case.prior.with_vertices(truth)
    assert twice.sigma == pytest.approx(plain.sigma, rel=0.1)
    assert (
        distances(twice.surface.vertices, target).mean()
        < 1.1 * distances(plain.surface.vertices, target).mean()
    )
    assert twice.warnings[0].code == "duplicate-points"
    assert re.search(r"1[45]\d of 300 points .* within \d.\d+ mm of it", twice.warnings[0].sentence)
    more = with_points(merged, case.points.xyz[5] - 0.05)
    weights = Deform().update(more, twice).weights
    assert weights is not None
    assert weights[-1] == weights[5]


def test_a_new_point_off_the_wall_is_doubted_at_once() -> None:
    case, _ = bent_case()
    fitted = Deform()(case.visible(), started(case))
    xyz = case.points.xyz
    for k in range(0, 60, 12):
        # some 8 mm inside
        more = with_points(case, xyz[:150].mean(axis=0) + 0.7 * (xyz[k] - xyz[:150].mean(axis=0)))
        updated = Deform().update(more, fitted)
        afresh = Deform()(more.visible(), started(case))
        # mm: as for a good point
        assert np.linalg.norm(updated.surface.vertices - afresh.surface.vertices, axis=1).mean() < 0.05


def test_an_update_says_what_has_changed() -> None:
    case, _ = bent_case()
    fitted = Deform()(case.visible(), started(case))
    more = with_points(case, case.points.xyz[0] + 0.5)
    moved = more.points.xyz.copy()
    moved[7] += 0.1
    with pytest.raises(InputError, match="point 7 is not what it was"):
        Deform().update(replace(more, points=replace(more.points, xyz=moved)), fitted)
    kind = more.points.type.copy()
    kind[9] = "inside"
    with pytest.raises(InputError, match="point 9 is not what it was"):
        Deform().update(replace(more, points=replace(more.points, type=kind)), fitted)
    with pytest.raises(InputError, match="the landmarks are not those"):
        Deform().update(replace(more, prior_landmarks={**more.prior_landmarks, "a": np.zeros(3)}), fitted)
    with pytest.raises(InputError, match="fitted to this prior"):
        Deform().update(replace(more, prior=more.prior.with_vertices(1.01 * more.prior.vertices)), fitted)


def test_a_sigma_of_almost_nothing_pins_the_surface_and_breaks_nothing() -> None:
    case, _ = bent_case()
    sigma = np.ones(len(case.points))
    sigma[3] = 1e-12
    found = Deform()(with_column(case, sigma=sigma).visible(), started(case))
    assert distances(case.points.xyz[3:4], found.surface)[0] < 0.25 * NOISE


def test_points_of_another_size_are_no_plausible_result() -> None:
    """Two and a half times too large, with a start that cannot make up for it: all points float, or the prior
    is blown up.
    """
    case, _ = bent_case()
    large = replace(case, points=replace(case.points, xyz=2.5 * case.points.xyz)).visible()
    with pytest.raises(
        SolverError, match=r"deform: .* outliers 100%.*: the points do not belong to this surface"
    ):
        Deform(landmarks=False)(large, started(case))
    found = Deform(landmarks=False, outliers="none")(large, started(case))
    warning = next(one for one in found.warnings if one.code == "volume-changed")
    assert re.match(r"the motion changes the enclosed volume by a factor of 1\d: ", warning.sentence)


def with_floating(case: Case, share: float) -> Case:
    """The case with a share of its first 200 points anywhere in a ball of 18 mm, well inside."""
    rng = np.random.default_rng(0)
    xyz = case.points.xyz.copy()
    count = int(200 * share)
    way = rng.normal(size=(count, 3))
    xyz[:count] = (
        18.0 * way / np.linalg.norm(way, axis=1, keepdims=True) * rng.uniform(size=(count, 1)) ** (1.0 / 3.0)
    )
    return replace(case, points=replace(case.points, xyz=xyz)).visible()


def test_most_points_off_the_wall_are_warned_of() -> None:
    case, truth = bent_case(count=200)
    found = Deform()(with_floating(case, 0.55), started(case))
    (warning,) = found.warnings
    assert warning.code == "many-outliers"
    assert warning.sentence.startswith("55% of the points are judged to be outliers")
    assert distances(found.surface.vertices, case.prior.with_vertices(truth)).mean() < NOISE


@pytest.mark.parametrize(("grain", "said"), [(0.3, False), (1.0, True)])
def test_a_crumpled_prior_is_warned_of(grain: float, said: bool) -> None:
    """Where every vertex is an edge's length off, nothing else says why noise and motion are wrong; grain of
    .3 edges is smoothed.
    """
    case, _ = bent_case()
    prior = case.prior
    edge = float(np.linalg.norm(np.diff(prior.vertices[prior.faces[:, :2]], axis=1), axis=2).mean())
    shift = grain * edge * np.random.default_rng(9_281).normal(size=(len(prior.vertices), 1))
    rough = replace(case, prior=prior.with_vertices(prior.vertices + shift * prior.vertex_normals))
    warnings = Deform()(rough, started(rough)).warnings
    assert any(warning.code == "crumpled-prior" for warning in warnings) == said


def test_small_pieces_of_a_prior_are_warned_of() -> None:
    case, _ = bent_case()
    crumbs = [sphere(0.5).vertices + place for place in case.prior.vertices[[3, 400]]]
    vertices = np.vstack([case.prior.vertices, *crumbs])
    faces = [case.prior.faces]
    faces += [sphere().faces + len(case.prior.vertices) + k * len(crumbs[0]) for k in (0, 1)]
    littered = replace(case, prior=Surface(vertices, np.vstack(faces)))
    (warning,) = Deform()(littered, started(littered)).warnings
    assert warning.code == "small-components"
    assert "2 small components" in warning.sentence


def test_vertices_that_no_face_uses_are_no_part_of_the_prior() -> None:
    """As decimation and clipping in other programs leave them: the deviation was none where they lay, and
    lengths were theirs too.
    """
    case, _ = bent_case()
    prior = case.prior
    stray = 3.0 * case.prior.vertices[:400]
    fields = {"region": np.r_[np.zeros(400), np.arange(len(prior.vertices))]}
    kept = replace(case, prior=Surface(np.vstack([stray, prior.vertices]), prior.faces + 400, fields))
    np.testing.assert_array_equal(kept.prior.vertices, prior.vertices)
    np.testing.assert_array_equal(kept.prior.fields["region"], np.arange(len(prior.vertices)))
    plain, found = Deform()(case, started(case)).surface, Deform()(kept, started(kept)).surface
    np.testing.assert_array_equal(found.fields["sd_mm"], plain.fields["sd_mm"])


def test_points_that_mean_no_surface_come_to_an_end() -> None:
    """They had the start pose corrected for ever."""
    case, _ = bent_case(count=200)
    with pytest.raises(SolverError, match="outliers 100%"):
        Deform()(with_floating(case, 0.65), started(case))


def test_points_there_must_be() -> None:
    case, _ = bent_case()
    bare = replace(case, points=case.points.of("landmark"))
    with pytest.raises(InputError, match="deform: case bent has no points of type eam"):
        Deform()(bare, started(case))


@pytest.mark.parametrize("column", ["force", "sigma"])
def test_an_update_says_where_what_is_known_of_a_point_has_changed(column: str) -> None:
    case, _ = bent_case()
    fitted = Deform()(with_column(case, **{column: np.full(len(case.points), 2.0)}), started(case))
    more = with_points(case, case.points.xyz[0] + 0.5)
    values = np.full(len(more.points), 2.0)
    values[11] = 9.0
    with pytest.raises(InputError, match="point 11 is not what it was"):
        Deform().update(with_column(more, **{column: values}), fitted)


def test_an_update_by_a_stage_of_other_parameters_is_refused() -> None:
    case, _ = bent_case()
    fitted = Deform()(case, started(case))
    more = with_points(case, case.points.xyz[0] + 0.5)
    with pytest.raises(InputError, match="other parameters"):
        Deform(amplitude_log_sd=0.5).update(more, fitted)
    with pytest.raises(InputError, match="or the stage's contact_force or outliers are not"):
        Deform(outliers="none").update(more, fitted)


def test_the_noise_of_a_point_that_says_none_is_the_usual_one() -> None:
    case, _ = bent_case()
    sigma = np.full(len(case.points), 2.0)
    sigma[:100] = np.inf
    sigma[100:110] = np.nan
    relative = with_column(case, sigma=sigma).points.relative_noise()
    np.testing.assert_array_equal(relative, np.ones(len(sigma)))


def test_new_points_of_another_noise_leave_that_of_the_others_as_it_was() -> None:
    case, _ = bent_case(count=40)
    fitted = Deform()(with_column(case, sigma=np.full(len(case.points), 2.0)), started(case))
    more = with_points(case, *(case.points.xyz[:60] + 0.1))  # so many that their median is the typical one
    sigma = np.where(np.isin(more.points.xyz, case.points.xyz).all(axis=1), 2.0, 8.0)
    updated = Deform().update(with_column(more, sigma=sigma), fitted)
    known = updated.fit.problem.data.at(slice(40))
    np.testing.assert_array_equal(known.relative, np.ones(40))
    assert (updated.fit.problem.data.relative[40:] == 4.0).all()
    assert updated.sigma == fitted.sigma
    noise = believed(updated.fit, template=False).noise
    np.testing.assert_allclose(noise / updated.sigma, updated.fit.problem.data.relative)


def test_an_estimate_of_another_prior_is_not_updated() -> None:
    """A level set that grew a tube has a motion of another mesh: its vertices on the prior's faces would be
    no surface.
    """
    case, _ = bent_case()
    fitted = Deform()(case.visible(), started(case))
    other = Deform()(
        replace(case.visible(), prior=replace(case.prior, faces=case.prior.faces[::-1])), started(case)
    )
    with pytest.raises(InputError, match="fitted to this prior"):
        Deform().update(case, other)
    with pytest.raises(InputError, match="fitted to this prior"):
        Deform().update(case, replace(fitted, motion=lambda points: points))


def test_the_first_ablation_point_may_come_later() -> None:
    case, _ = bent_case()
    stage = Deform(ablation="fit")
    kind = case.points.type
    rows = np.flatnonzero(kind != "ablation")
    before = replace(case, points=case.points.select(rows))
    after = replace(case, points=case.points.select(np.r_[rows, np.flatnonzero(kind == "ablation")[0]]))
    updated = stage.update(after, stage(before.visible(stage.fits), started(before)))
    assert np.isfinite(updated.surface.vertices).all()
    assert len(updated.fit.state.weights) == 151


def test_points_known_to_be_inside_are_not_counted_as_off_the_wall() -> None:
    case, _ = bent_case()
    kind = np.r_[case.points.type, np.full(50, "inside")]
    name = np.r_[case.points.columns["name"], np.full(50, "")]
    points = Points(np.vstack([case.points.xyz, 0.4 * case.points.xyz[:50]]), kind, {"name": name})
    found = Deform()(replace(case, points=points).visible(), started(case))
    assert found.weights is not None
    assert found.facts["outlier_fraction"] == pytest.approx(1.0 - found.weights.mean())
    assert found.facts["outlier_fraction"] < 0.1


def test_a_small_amplitude_log_sd_holds_the_amplitudes_where_they_are_expected() -> None:
    case, _ = bent_case()
    found = Deform(amplitude_log_sd=1e-3)(case.visible(), started(case))
    assert found.fit is not None
    np.testing.assert_allclose(found.fit.state.scales.log, found.fit.state.scales.prior_log, atol=0.01)


def test_an_update_says_what_its_points_have_made_of_the_estimate() -> None:
    """Warnings are those of the points of now: what the estimate said of fewer is not said again, nor
    twice.
    """
    case, _ = bent_case()
    fitted = Deform()(case.visible(), started(case))
    stage = Deform()
    assert stage.update(with_points(case, case.points.xyz[:5].mean(axis=0)), fitted).warnings == ()
    middle = case.prior.vertices.mean(axis=0)
    floating = [middle + depth * (at - middle) for depth in (0.2, 0.3) for at in case.points.xyz[:150]]
    some = stage.update(with_points(case, *floating[:200]), fitted)
    more = stage.update(with_points(case, *floating), some)
    for found, count, now in ((some, 200, 350), (more, 300, 450)):
        assert [one.code for one in found.warnings] == ["many-outliers", "outdated-amplitudes"]
        assert all(one.stage == "deform" for one in found.warnings)
        many, old = (one.sentence for one in found.warnings)
        assert f"the first 150 of {now} points" in old
        assert many.startswith(f"{found.facts['outlier_fraction']:.0%} of the points")
        assert found.facts["outlier_fraction"] > 0.9 * count / now


def test_warnings_of_earlier_stages_stay() -> None:
    case, _ = bent_case()
    # of a code that an update judges again, but of another stage
    before = RunWarning("many-outliers", "from before", "earlier")
    found = Deform()(case.visible(), replace(started(case), warnings=(before,)))
    assert found.warnings[0] == before
    assert LevelSet()(case.visible(), found).warnings[0] == before
    assert Deform().update(case.visible(), found).warnings[0] == before


@pytest.mark.parametrize(
    ("factor", "said"), [(0.6, ["by a factor of 0.22"]), (1.0, []), (1.6, ["by a factor of 4.1"])]
)
def test_a_volume_that_no_heartbeat_has_is_warned_of(factor: float, said: list[str]) -> None:
    case, _ = bent_case()
    found = changed_volume(case.prior, case.prior.with_vertices(factor * case.prior.vertices))
    assert all(one.code == "volume-changed" for one in found)
    assert all(words in one.sentence for words, one in zip(said, found, strict=True))


def test_a_wall_that_follows_what_is_not_of_it_is_warned_of(monkeypatch: pytest.MonkeyPatch) -> None:
    case, _ = bent_case()
    found = Deform()(case, started(case))
    assert found.fit is not None
    assert not captured(found.fit)
    assert not stretched(found.fit, found.surface, "mm")
    monkeypatch.setattr(
        type(found.fit.problem),
        "first_weights",
        property(lambda self: np.where(np.arange(len(self.data.points)) < 30, 0.1, 0.9)),
    )
    assert [one.code for one in captured(found.fit)] == ["captured-points"]
    pulled = found.surface.vertices.copy()
    pulled[pulled[:, 0] > 0.7 * pulled[:, 0].max(), 0] *= 4.0
    (warning,) = stretched(found.fit, found.surface.with_vertices(pulled), "mm")
    assert warning.code == "stretched-wall"
    assert re.search(r"to more than 2 times its length, around \(.*\) mm", warning.sentence)


def test_a_landmark_that_was_marked_at_the_place_of_another_is_warned_of() -> None:
    case, _ = bent_case()
    xyz = case.points.xyz.copy()
    (wrong, other) = np.flatnonzero(case.points.type == "landmark")[:2]
    assert not swapped_landmarks(case, np.eye(4))
    xyz[wrong] = xyz[other] + 1.0
    (found,) = swapped_landmarks(replace(case, points=replace(case.points, xyz=xyz)), np.eye(4))
    assert found.code == "landmark-swapped-place"
    assert "landmark a lies" in found.sentence
    assert "from that of b: was it measured there?" in found.sentence
    assert not swapped_landmarks(replace(case, prior_landmarks={}), np.eye(4))


def test_a_motion_that_turns_the_prior_inside_out_is_an_error() -> None:
    case, _ = bent_case()
    turned = Surface(case.prior.vertices, case.prior.faces[:, ::-1])
    with pytest.raises(SolverError, match="inside out"):
        changed_volume(case.prior, turned)


@pytest.mark.parametrize(("behind", "warned"), [(1.0, True), (50.0, False)])
def test_an_alternative_is_warned_of_only_where_the_points_hardly_prefer(behind: float, warned: bool) -> None:
    surface = body(3)
    best, other = (
        SimpleNamespace(
            vertices=surface.vertices + shift,
            energy=100.0 + energy,
            sigma=0.5,
            facts={},
        )
        for shift, energy in ((0.0, 0.0), (3.0, behind))
    )
    codes = [one.code for one in alternatives(best, [best, other], "mm")]  # type: ignore[arg-type, list-item]
    assert codes == ["alternative-start"] * warned
    best.facts = {"alternative_excluded": 7.0, "alternative_behind": behind, "alternative_apart": 3.0}
    found = alternatives(best, [best], "mm")  # type: ignore[arg-type, list-item]
    assert [one.code for one in found] == ["alternative-points"] * warned
    assert all("without 7 points" in one.sentence for one in found)


@pytest.mark.parametrize(
    ("gradient", "whose", "asked"),
    [(0.15, "patient", False), (0.25, "patient", True), (0.25, "template", False)],
)
def test_a_patients_prior_that_bends_as_into_another_heart_is_asked_about(
    gradient: float, whose: str, asked: bool
) -> None:
    case = replace(read_case(demo_case()), prior_of=whose)
    fit = cast(MotionFit, SimpleNamespace(gradient=gradient))
    assert [one.code for one in another_heart(case, fit)] == ["prior-of-another"] * asked
