"""A shifted part of the map in the stage and in a whole run: named, or taken out of its points everywhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chamber import sampled
from fields import bend, body

from o3dls.arrays import Array
from o3dls.case import Case, Points, Truth
from o3dls.estimate import SHIFTED, Estimate
from o3dls.evaluation.distances import distances
from o3dls.io.points import read_points
from o3dls.noise.shifted_part import MapPart, MapShift
from o3dls.pipeline.cross_validation import cross_validate
from o3dls.pipeline.pipeline import Pipeline
from o3dls.plugins.stage import Stage
from o3dls.stages.deform import Deform

NOISE = 1.0
COUNT, FIRST = 160, 100  # points, and the first one that was taken after the slip
OFFSET = np.array([1.0, -7.0, 6.0])  # 9.3 mm


def case_of(offset: Array) -> Case:
    """A body that moved, and its map, whose last points carry an offset; ablation points of before and
    after.
    """
    prior = body(3)
    truth = prior.with_vertices(prior.vertices + bend(prior, 71_191))
    xyz = sampled(truth, COUNT, 8_837, NOISE)
    xyz[FIRST:] += offset
    ablation = sampled(truth, 20, 8_839)
    order = np.r_[0:FIRST, COUNT : COUNT + 10, FIRST:COUNT, COUNT + 10 : COUNT + 20]
    ablation[10:] += offset
    kind = np.array(["eam"] * COUNT + ["ablation"] * 20)
    points = Points(np.vstack([xyz, ablation])[order], kind[order])
    return Case("slipped", prior, points, truth=Truth(truth, held_out=sampled(truth, 400, 8_861)))


def fitted(case: Case, **parameters: str) -> Estimate:
    start = Estimate(case.prior, np.eye(4), "as it stands")
    return Deform(**parameters)(case.visible(), start)  # type: ignore[arg-type]


def off(case: Case, estimate: Estimate) -> float:
    """Mean distance of noise-free points of the truth, mm."""
    assert case.truth is not None
    assert case.truth.held_out is not None
    return float(distances(case.truth.held_out, estimate.surface).mean())


def test_a_shifted_part_is_named_and_nothing_else_is_done() -> None:
    case = case_of(OFFSET)
    said, silent = fitted(case), fitted(case, map_shift="ignore")
    (warning,) = (one for one in said.warnings if one.code == "map-shift")
    assert f"of {COUNT} points, those taken from point 111" in warning.sentence  # behind ten ablation points
    assert 'deform.map_shift = "fit"' in warning.sentence
    assert not [one for one in silent.warnings if one.code == "map-shift"]
    np.testing.assert_array_equal(said.surface.vertices, silent.surface.vertices)
    assert said.facts["map_shift"]["taken_out"] is False
    assert said.map_shift is None
    assert said.corrected(case) is case


def by_place(case: Case, times: Array) -> Case:
    """The case with times (n,), its rows sorted by place."""
    rows = np.argsort(case.points.xyz[:, 0])
    points = Points(case.points.xyz[rows], case.points.type[rows], {"time": times[rows]})
    return replace(case, points=points)


def test_points_are_taken_at_their_times_and_not_as_rows_come() -> None:
    case = case_of(OFFSET)
    seconds = np.where(case.points.type == "eam", 3.0 * np.arange(len(case.points)), np.nan)
    sorted_ = by_place(case, seconds)
    (warning,) = (one for one in fitted(sorted_).warnings if one.code == "map-shift")
    assert f"of {COUNT} points, those taken from time 330 on, lie" in warning.sentence
    some = sorted_.points.select(np.arange(0, len(sorted_.points), 2))
    assert (np.diff(some.taken[np.argsort(some.numbers("time"), kind="stable")]) > 0).all()
    # numbers below 0 are no times, and a map of which a point has none is as the rows come
    for unusable in (seconds - 200.0, np.where(np.arange(len(seconds)) == 7, np.nan, seconds)):
        points = by_place(case, unusable).points
        assert np.array_equal(points.taken, np.arange(len(points)))


def test_with_the_offset_taken_out_the_surface_is_that_of_the_whole_map() -> None:
    case, whole = case_of(OFFSET), case_of(np.zeros(3))
    found, without = fitted(case, map_shift="fit"), fitted(whole)
    # mm: a tenth of what the offset would do, and an eighth of the noise
    assert abs(off(whole, found) - off(whole, without)) < 0.12
    assert off(whole, fitted(case)) > off(whole, without) + 1.0
    assert taken_out_of(found) == pytest.approx(OFFSET, abs=1.5)
    assert "an offset was taken out of" in found.status
    assert [one.code for one in found.warnings] == ["map-shift"]
    assert not [one for one in without.warnings if one.code == "map-shift"]


def taken_out_of(found: Estimate) -> list[float]:
    assert found.facts["map_shift"]["taken_out"] is True
    return list(found.facts["map_shift"]["offset"])


def test_all_points_of_the_part_are_corrected_and_marked_whatever_their_type() -> None:
    case = case_of(OFFSET)
    found = fitted(case, map_shift="fit")
    seen = found.corrected(case).points
    moved = seen.columns[SHIFTED] == 1.0
    assert found.map_shift is not None
    np.testing.assert_allclose(
        seen.xyz, case.points.xyz - moved[:, None] * found.map_shift.offset, atol=1e-12
    )
    # the ablation points of before the slip, and those of after
    assert moved[seen.type == "ablation"].tolist() == [False] * 10 + [True] * 10
    assert abs(moved[seen.type == "eam"].sum() - (COUNT - FIRST)) <= 3


class Seen(Stage):
    """A stage that keeps the points it was shown."""

    name = "seen"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        return replace(start, facts={"points": case.points.xyz.tolist()})


def test_later_stages_scores_and_files_have_the_corrected_points(tmp_path: Path) -> None:
    case, whole = case_of(OFFSET), case_of(np.zeros(3))
    run = Pipeline([Deform(map_shift="fit"), Seen()], folds=0).run(case)
    other = Pipeline([Deform()], folds=0).run(whole)
    last = run.estimates["seen"]
    corrected = run.estimates["deform"].corrected(case).points
    np.testing.assert_array_equal(last.facts["points"], corrected.xyz[corrected.type == "eam"])
    for group in ("fitted", "ablation", "held_out"):
        # mm: half of the noise; with the offset in them they would be off by several mm
        assert run.scores["deform"][group]["mean_mm"] == pytest.approx(
            other.scores["deform"][group]["mean_mm"], abs=0.5 * NOISE
        )
    folder = run.write(tmp_path / "run")
    np.testing.assert_allclose(read_points(folder / "points.csv", 3).xyz, corrected.xyz, atol=1e-4)
    np.testing.assert_allclose(read_points(folder / "case" / "points.csv", 3).xyz, corrected.xyz, atol=1e-4)
    assert SHIFTED in read_points(folder / "points.csv", 3).columns


def test_points_that_a_fold_leaves_out_are_scored_without_the_offset_that_it_found() -> None:
    case, whole = case_of(OFFSET), case_of(np.zeros(3))
    assert case.truth is not None
    assert case.truth.surface is not None
    true = case.truth.surface
    shift = MapShift(MapPart(None, FIRST + 9.5), OFFSET, np.ones(3), 30.0, COUNT - FIRST, COUNT)
    estimates = {
        "icp": Estimate(true, np.eye(4), "before"),
        "deform": Estimate(true, np.eye(4), "without", map_shift=shift),
    }
    left_out = cross_validate(lambda part: estimates, case, 2)
    expected = distances(whole.points.of("eam").xyz, true)
    np.testing.assert_allclose(left_out["deform"].distance, expected)
    np.testing.assert_allclose(left_out["icp"].distance, expected)  # all of a run on the same points


def test_a_second_stage_does_not_ask_again() -> None:
    case = case_of(OFFSET)
    first = fitted(case, map_shift="fit")
    again = Deform()(first.corrected(case).visible(), first)
    assert again.map_shift is first.map_shift
    assert "map_shift" not in again.facts


def test_an_update_corrects_the_points_that_are_new() -> None:
    case = case_of(OFFSET)
    eam = replace(case, points=case.points.of("eam"))
    found = fitted(eam, map_shift="fit")
    xyz = np.vstack([eam.points.xyz, eam.points.xyz[3] + OFFSET + 0.4])
    more = replace(eam, points=Points(xyz, np.full(len(xyz), "eam"), order=np.r_[eam.points.taken, 500.0]))
    updated = Deform(map_shift="fit").update(more, found)
    assert updated.weights is not None
    assert updated.weights[-1] > 0.9  # with the offset in it, it would be far off
    assert updated.map_shift is found.map_shift
