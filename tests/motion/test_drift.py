"""Errors that points share with those taken before and after them are told from the wall by their order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fields import bend, body, spots, wall

from o3dls import Deform, LevelSet, Pipeline
from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.evaluation.statistics import BAND_95
from o3dls.geometry.surface import Surface
from o3dls.motion.drift import fit_with_drift
from o3dls.motion.drift_settings import DriftSettings
from o3dls.motion.field.drift import Drift, Taken, grams
from o3dls.motion.field.gaussian_process import solve
from o3dls.motion.field.marginal_likelihood import MarginalLikelihood
from o3dls.motion.fit import fit_motion
from o3dls.motion.iteration import find_feet, gather_rows
from o3dls.motion.result import MotionFit, sentence
from o3dls.motion.settings import MotionSettings
from o3dls.stages.deform_checks import order_lost
from o3dls.stages.level_set_data import believed

COUNT = 400
OWN, SHARED = 0.5, 1.4  # mm: what each point has for itself, and groups have in common, along each axis
GROUP = 14


def path(surface: Surface, count: int, seed: int) -> Array:
    """Places (n, 3) on a wall in the order of a tour: the next is the nearest that is left."""
    at = spots(surface, count, seed)[0]
    left, here = list(range(1, count)), 0
    rows = [0]
    while left:
        here = left.pop(int(np.linalg.norm(at[left] - at[here], axis=1).argmin()))
        rows.append(here)
    return np.asarray(rows)


def mapped(
    count: int = COUNT, shared: float = SHARED, seed: int = 5_000
) -> tuple[Surface, Array, Array, Array]:
    """A body, where its vertices truly went, points on a tour over it, and their errors in common (n, 3)."""
    surface = body(3)
    truth = surface.vertices + bend(surface, seed)
    _, face, bary = spots(surface, count, seed + 1)
    rows = path(surface, count, seed + 1)
    points = np.einsum("nc,ncd->nd", bary[rows], truth[surface.faces[face[rows]]])
    rng = np.random.default_rng(seed + 2)
    common = np.repeat(shared * rng.normal(size=(count // GROUP + 1, 3)), GROUP, axis=0)[:count]
    own = np.hypot(OWN, 0.0 if shared else SHARED)
    return surface, truth, points + common + own * rng.normal(size=(count, 3)), common


def fitted(surface: Surface, points: Array, **of_points: object) -> MotionFit:
    return fit_motion(surface.vertices, surface.faces, np.eye(4), wall(points, **of_points))  # type: ignore[arg-type]


def off_wall(surface: Surface, truth: Array, fit: MotionFit) -> Array:
    """Signed distance (n,) of the vertices from where they went, along the true normals."""
    return np.asarray(((fit.vertices - truth) * surface.with_vertices(truth).vertex_normals).sum(axis=1))


def test_errors_in_common_are_found_and_the_deviation_holds() -> None:
    held = list[float]()
    before = list[float]()
    errors = list[list[float]]()
    for seed in (5_000, 5_100, 5_200):
        surface, truth, points, _ = mapped(seed=seed)
        independent = fitted(surface, points)
        fit = fit_with_drift(independent)
        assert fit is not None
        assert fit.converged
        for found, one in ((before, independent), (held, fit)):
            found.append((np.abs(off_wall(surface, truth, one)) < 1.96 * one.sd).mean())
        errors.append([np.abs(off_wall(surface, truth, one)).mean() for one in (independent, fit)])
        assert 0.75 < fit.sigma / np.hypot(OWN, SHARED) < 1.3
        assert "common to points taken one after the other" in sentence(fit, "mm")
        assert "common" not in sentence(independent, "mm")
    assert np.mean(held) > 0.9 > np.mean(before)
    assert np.mean(errors, axis=0)[1] < 0.9 * np.mean(errors, axis=0)[0]


@pytest.mark.parametrize("seed", [5_300, 5_400, 5_500])
def test_independent_errors_keep_their_fit(seed: int) -> None:
    surface, _, points, _ = mapped(shared=0.0, seed=seed)
    assert fit_with_drift(fitted(surface, points)) is None


def test_the_order_is_what_tells_and_may_be_a_column() -> None:
    surface, _, points, _ = mapped()
    mixed = np.random.default_rng(1).permutation(COUNT)
    assert fit_with_drift(fitted(surface, points[mixed])) is None
    by_time = fit_with_drift(fitted(surface, points[mixed], order=mixed.astype(float)))
    in_order = fit_with_drift(fitted(surface, points))
    assert by_time is not None
    assert in_order is not None
    apart = np.linalg.norm(by_time.vertices - in_order.vertices, axis=1)
    assert apart.mean() < 0.15  # mm: outliers in runs are sought in the order of the file


def test_groups_bring_back_a_part_of_a_lost_order() -> None:
    found = 0
    for seed in (5_000, 5_100, 5_200):
        surface, _, points, _ = mapped(seed=seed)
        mixed = np.random.default_rng(1).permutation(COUNT)
        assert fit_with_drift(fitted(surface, points[mixed])) is None
        found += fit_with_drift(fitted(surface, points[mixed], moment=mixed // GROUP)) is not None
    assert found == 3


def test_groups_in_order_change_nothing() -> None:
    data = wall(mapped()[2])
    together = replace(data, moment=np.arange(COUNT) // GROUP)
    np.testing.assert_array_equal(together.place_in_order, data.place_in_order)
    assert together.at(np.array([5, 0, 90])).place_in_order.tolist() == [0.0, 1.0, 2.0]
    torn = replace(data.at(slice(4)), moment=np.array([0, 1, 0, 2]))
    assert torn.place_in_order.tolist() == [0.0, 2.0, 1.0, 3.0]


def test_few_points_are_not_asked() -> None:
    surface, _, points, _ = mapped(count=50)
    assert fit_with_drift(fitted(surface, points)) is None


def test_points_that_share_rows_share_them_only_with_those_taken_soon_after() -> None:
    surface, truth, points, _ = mapped()
    settings = MotionSettings()
    few = replace(settings, iteration=replace(settings.iteration, most_rows=100))
    few = replace(few, drift=replace(few.drift, most_rows=300))
    independent = fit_motion(surface.vertices, surface.faces, np.eye(4), wall(points), few)
    fit = fit_with_drift(independent)
    assert fit is not None
    assert fit.drift is not None
    row, place = fit.drift.taken.row, fit.drift.taken.place
    assert 100 < row.max() + 1 <= 300
    for one in np.unique(row):
        assert np.ptp(place[row == one]) < 8 * settings.drift.block
    error, before = (np.abs(off_wall(surface, truth, one)).mean() for one in (fit, independent))
    assert error < before


def test_offsets_are_those_of_the_points() -> None:
    """Of the part along the wall's normal, which distances show, most is found."""
    surface, truth, points, common = mapped()
    fit = fit_with_drift(fitted(surface, points))
    assert fit is not None
    assert fit.drift is not None
    found, left = fit.drift.offsets()
    moved = surface.with_vertices(truth)
    _, face, _, _ = moved.closest_point.query(points - common)
    normals = moved.face_normals[face]
    true, seen = ((one * normals).sum(axis=1) for one in (common, found))
    assert np.corrcoef(true, seen)[0, 1] > 0.7
    assert ((true - seen) ** 2).mean() < 0.5 * (true**2).mean()
    assert (np.abs(true - seen) < 1.96 * np.sqrt(left)).mean() > 0.85
    assert (left < (fit.state.scales.drift_sds**2).sum()).all()


def test_a_tip_that_presses_is_told_from_one_that_is_shifted() -> None:
    """Pressure is alike whichever way the wall faces: its offsets are along the normals."""
    surface, truth, points, common = mapped(shared=0.0)
    outward = surface.with_vertices(truth).face_normals
    facing = outward[surface.with_vertices(truth).closest_point.query(points)[1]]
    rng = np.random.default_rng(5_003)
    pressed = np.repeat(1.5 * rng.normal(size=len(points) // GROUP + 1), GROUP)[: len(points)]
    # independent errors of `mapped` are large where none are shared
    moved = points + pressed[:, None] * facing
    fit = fit_with_drift(fitted(surface, moved))
    assert fit is not None
    assert fit.drift is not None
    assert fit.facts["pressure_12"] > 2.0 * fit.facts["drift_12"]
    found = (fit.drift.offsets()[0] * facing).sum(axis=1)
    assert np.corrcoef(found, pressed)[0, 1] > 0.7
    assert not common.any()


def test_offsets_of_many_points_are_those_of_few_at_a_time() -> None:
    surface, _, points, _ = mapped()
    fit = fit_with_drift(fitted(surface, points))
    assert fit is not None
    assert fit.drift is not None
    parts = replace(fit.drift, settings=replace(fit.drift.settings, at_once=150)).offsets()
    for one, other in zip(parts, fit.drift.offsets(), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_the_covariance_is_that_of_the_formula_and_landmarks_have_none() -> None:
    rng = np.random.default_rng(3)
    directions, place = rng.normal(size=(7, 3)), np.arange(4.0) * 2.0
    taken = Taken(place, place, np.arange(4))
    shift, pressure = grams(directions, taken, DriftSettings(shifts=(5.0,), pressures=(3.0,)))
    size = np.linalg.norm(directions, axis=1)
    for i, j in np.ndindex(7, 7):
        apart, known = abs(i - j) * 2.0, max(i, j) < 4
        assert shift[i, j] == pytest.approx(known * directions[i] @ directions[j] * np.exp(-apart / 5.0))
        assert pressure[i, j] == pytest.approx(known * size[i] * size[j] * np.exp(-apart / 3.0))


def test_offsets_are_the_posterior_mean_and_variance_of_the_dense_formula() -> None:
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(5, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    place, z = np.array([0.0, 1.0, 5.0, 6.0, 30.0]), rng.normal(size=5)
    taken = Taken(place, place, np.arange(5))
    settings = MotionSettings().drift
    sds = np.array([1.3, 0.7, 0.9])
    other = 0.4 * np.eye(5) + 0.2
    between = sum(sd**2 * gram for sd, gram in zip(sds, grams(directions, taken, settings), strict=True))
    solved, _ = solve(np.asarray(between + other), z)
    mean, left = Drift(settings, sds, taken, directions, solved).offsets()
    inverse = np.linalg.inv(between + other)
    np.testing.assert_allclose((mean * directions).sum(axis=1), between @ inverse @ z, atol=1e-12)
    np.testing.assert_allclose(left, np.diag(between - between @ inverse @ between), atol=1e-12)


def test_the_score_is_the_slope_of_the_evidence() -> None:
    """By central differences, over the expected square of its own slope."""
    surface, _, points, _ = mapped(count=100)
    fit = fitted(surface, points)
    problem, scales = fit.problem, fit.state.scales
    rows = gather_rows(problem, find_feet(problem, fit.state), fit.state)
    likelihood = MarginalLikelihood.of(problem.covariance, rows)
    taken = Taken(np.arange(100.0), np.arange(100.0), np.arange(100))
    part = grams(rows.observed.directions, taken, problem.settings.drift)[0]
    matrix, _ = likelihood.covariance(scales.log)
    step = 1e-4
    energies = [solve(matrix + sign * step * part, rows.residual)[0].energy for sign in (-1.0, 1.0)]
    rise = (energies[0] - energies[1]) / (2.0 * step)
    share = np.linalg.inv(matrix) @ part
    information = 0.5 * np.trace(share @ share)
    assert likelihood.pull(scales.log, part) == pytest.approx(rise / np.sqrt(information), rel=1e-4)


def test_an_update_goes_on_with_what_errors_have_in_common() -> None:
    surface, _, points, _ = mapped()
    fit = fit_with_drift(fitted(surface, points[:-10]))
    anew = fit_with_drift(fitted(surface, points))
    assert fit is not None
    assert anew is not None
    same = fit_motion(surface.vertices, surface.faces, np.eye(4), wall(points[:-10]), warm=fit)
    assert np.linalg.norm(same.vertices - fit.vertices, axis=1).mean() < 0.05
    later = fit_motion(surface.vertices, surface.faces, np.eye(4), wall(points), warm=fit)
    assert later.drift is not None
    assert len(later.drift.taken.place) == COUNT
    assert later.sigma == fit.sigma
    left, before = (np.linalg.norm(one.vertices - anew.vertices, axis=1).mean() for one in (later, fit))
    assert left < 0.5 * before


def test_the_stage_says_what_it_found_and_may_be_told_not_to_ask() -> None:
    surface, _, points, _ = mapped(count=250)
    case = Case("case", surface, Points(points, np.full(len(points), "eam")))
    asked, not_asked = (
        Pipeline([Deform(shared_errors=choice)], folds=0).run(case).estimates["deform"]
        for choice in ("find", "ignore")
    )
    (warning,) = (one for one in asked.warnings if one.code == "errors-together")
    assert warning.grade == "good"
    assert "share an error of" in warning.sentence
    assert "errors-together" not in {one.code for one in not_asked.warnings}
    assert asked.sigma is not None
    assert not_asked.sigma is not None
    assert asked.sigma > not_asked.sigma
    assert set(asked.facts) - set(not_asked.facts) >= {"drift_12", "drift_60", "pressure_12"}


def test_the_level_set_is_given_points_without_the_errors_that_they_share() -> None:
    surface, truth, points, _ = mapped()
    independent = fitted(surface, points)
    fit = fit_with_drift(independent)
    assert fit is not None
    moved = surface.with_vertices(truth)
    given, plain = (believed(one, template=False) for one in (fit, independent))
    np.testing.assert_array_equal(plain.points, points)
    off, before = (np.sqrt(moved.closest_point.query(one.points)[0].mean()) for one in (given, plain))
    assert off < 0.8 * before
    assert fit.drift is not None
    mean_of_24 = np.sqrt(((given.noise**2 - fit.state.scales.noises[0] ** 2) / 24.0).mean())
    np.testing.assert_allclose(mean_of_24, np.sqrt(fit.drift.offsets()[1].mean()))


def test_a_map_whose_order_was_destroyed_is_warned_of_and_no_other() -> None:
    def codes(points: Array) -> set[str]:
        case = Case("case", surface, Points(points, np.full(len(points), "eam")))
        return {one.code for one in Pipeline([Deform()], folds=0).run(case).estimates["deform"].warnings}

    surface, _, points, _ = mapped(count=250)
    assert "order-lost" not in codes(points)
    shuffled = np.random.default_rng(1).permutation(len(points))
    assert "order-lost" in codes(points[shuffled])
    surface, _, points, _ = mapped(count=250, shared=0.0)  # as much noise, none of it shared
    assert "order-lost" not in codes(points[shuffled])


def test_bands_are_wider_where_the_order_was_destroyed_and_stay_so() -> None:
    """Of mapped wall they hold more than without, and level_set and update leave them as wide."""
    surface, truth, points, _ = mapped(count=250)
    shuffled = points[np.random.default_rng(1).permutation(len(points))]
    case = Case("case", surface, Points(shuffled, np.full(len(points), "eam")))
    run = Pipeline([Deform(), LevelSet()], folds=0).run(case)
    wide, final = run.estimates["deform"], run.estimates["level_set"]
    narrow = Pipeline([Deform(shared_errors="ignore")], folds=0).run(case).estimates["deform"]
    assert wide.fit is not None
    doubt = wide.fit.motion.doubt
    assert doubt > 0.2
    sd, plain = wide.surface.fields["sd_mm"], narrow.surface.fields["sd_mm"]
    np.testing.assert_allclose(sd, np.hypot(plain, doubt))
    along = surface.vertices, wide.surface.vertex_normals
    assert wide.motion is not None
    assert narrow.motion is not None
    np.testing.assert_allclose(wide.motion.sd(*along), np.hypot(narrow.motion.sd(*along), doubt))
    assert final.surface.fields["sd_mm"].min() > doubt
    off = np.abs(surface.with_vertices(truth).closest_point.distance(wide.surface.vertices))
    inside = [(off <= BAND_95 * one).mean() for one in (plain, sd)]
    assert inside[1] > inside[0] + 0.02
    again = Deform().update(case, wide)
    assert again.fit is not None
    assert again.fit.motion.doubt == doubt


def test_the_note_of_a_lost_order_says_what_it_means_and_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("o3dls.motion.drift.lost_order", lambda _: 1.7)
    surface, _, points, _ = mapped(count=20)
    case = Case("case", surface, Points(points, np.full(len(points), "eam")))
    (said,) = order_lost(case, None)  # type: ignore[arg-type]
    assert "the wall moves by 1.7 mm over short lengths" in said.sentence
    assert "the deviation allows for a part of it; export the points with their times" in said.sentence
