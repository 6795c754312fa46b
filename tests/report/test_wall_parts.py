"""What the first screen says of the mapped wall and of the wall without points, apart."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.checks import checks
from o3dls.report.page import report_page
from o3dls.report.sections.outcome import overall
from o3dls.report.subject import read_subject
from o3dls.report.verdict import verdict
from o3dls.report.wall_parts import MAPPED, PRIOR_ONLY, wall_parts
from tests.finished import Icp, LevelSet, bulged_case, finished, finished_2d


class Harm(LevelSet):
    """Better where x > -10, where the points are, and worse by some 2 mm on the other side."""

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        found = super().__call__(case, start)
        moved = found.surface.vertices.copy()
        moved[:, 0] -= 2.0 * (moved[:, 0] < -9.0)
        return replace(found, surface=found.surface.with_vertices(moved))


class Rigid(Icp):
    """A baseline that is worse than `icp`, and comes after it."""

    name: ClassVar[str] = "icp"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        found = super().__call__(case, start)
        return replace(found, surface=found.surface.with_vertices(found.surface.vertices + 1.5))


@pytest.fixture(scope="module")
def harmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("parts") / "run"
    return Pipeline([Icp(), Harm()], folds=0).run(bulged_case()).write(folder)


def test_parts_are_those_of_run_json(harmed: Path) -> None:
    """Also the baseline's: the means of the two sets of held-out points."""
    estimates = json.loads((harmed / "run.json").read_text())["estimates"]
    mapped, prior_only = wall_parts(read_subject([harmed]))
    for part, group in ((mapped, "held_out_seen"), (prior_only, "held_out_unseen")):
        assert part.found == pytest.approx(estimates["level_set"]["scores"][group]["mean_mm"], abs=1e-4)
        assert part.gain is not None
        assert part.gain.first == pytest.approx(estimates["icp"]["scores"][group]["mean_mm"], abs=1e-4)
        assert part.n == estimates["icp"]["scores"][group]["n"]


def test_harm_without_points_is_said_on_the_first_screen(harmed: Path) -> None:
    subject = read_subject([harmed])
    mapped, prior_only = wall_parts(subject)
    assert not mapped.worse
    assert prior_only.worse
    assert f"Worse than icp ({PRIOR_ONLY}): farther by " in verdict(subject)
    found = next(one for one in checks(subject) if one.name == "Against icp")
    assert found.grade == "amber"
    assert f"{MAPPED}: closer by" in found.said
    page = report_page(subject)
    head, whole = page[page.index("<header>") :].split('id="outcome"')
    assert f"Against icp: {found.short}" in head
    assert found.short.startswith("farther by ")
    assert f'<th scope="row">{PRIOR_ONLY}</th>' in whole
    assert "<strong>farther by " in whole


def test_without_harm_none_is_said(tmp_path: Path) -> None:
    subject = read_subject([finished(tmp_path / "run")])
    assert "Worse" not in verdict(subject)
    assert next(one for one in checks(subject) if one.name == "Against icp").grade == "good"


def test_the_best_baseline_is_compared_with_wherever_it_stands(tmp_path: Path) -> None:
    stages = [Icp(as_="icp_similarity"), Rigid(as_="icp_rigid"), LevelSet()]
    folder = Pipeline(stages, folds=0).run(bulged_case()).write(tmp_path / "run")
    for compare in ((), ("icp_rigid", "level_set")):
        subject = read_subject([folder], compare)
        assert subject.first is not None
        assert subject.first.name == "icp_similarity"
        assert "icp_similarity" in verdict(subject)
    assert read_subject([folder]).shown == ["icp_similarity", "level_set"]


def test_a_pose_that_icp_made_worse_is_the_baseline(tmp_path: Path) -> None:
    """Whatever stage found it: the best baseline is the best."""

    class Search(Icp):
        name: ClassVar[str] = "search"

    folder = Pipeline([Search(), Rigid(), LevelSet()], folds=0).run(bulged_case()).write(tmp_path / "run")
    subject = read_subject([folder])
    assert subject.first is not None
    assert subject.first.name == "search"
    assert subject.shown == ["search", "level_set"]
    assert {one.name for one in checks(subject)} >= {"Against search"}
    assert "icp makes the prior" in next(one.said for one in checks(subject) if one.name == "Size")


def test_other_sets_are_told_apart_by_the_distance_to_fitted_points(tmp_path: Path) -> None:
    case = bulged_case()
    assert case.truth is not None
    near = case.points.xyz[:, 0] > 0
    points = case.points.select(near | (case.points.type == "landmark"))
    case = replace(case, points=points, truth=replace(case.truth, unseen=None))
    subject = read_subject([finished(tmp_path / "run", case)])
    mapped, prior_only = wall_parts(subject)
    fitted = points.of("eam").xyz
    held_out = case.truth.held_out if case.truth else None
    assert held_out is not None
    gap = np.linalg.norm(held_out[:, None] - fitted[None], axis=2).min(axis=1)
    assert prior_only.n == int((gap > 10.0).sum()) > 20
    assert mapped.n == len(held_out) - prior_only.n
    assert mapped.expected is not None
    assert prior_only.expected is not None


def test_where_all_was_fitted_nothing_is_found(tmp_path: Path) -> None:
    case = replace(bulged_case(), truth=None, points=bulged_case().points.of("eam"))
    subject = read_subject([finished(tmp_path / "run", case)])
    assert [(one.found, one.gain, one.n) for one in wall_parts(subject)] == [(None, None, 0)] * 2
    assert "no points left out" in report_page(subject)
    assert wall_parts(read_subject([finished_2d(tmp_path / "flat")])) == []


def test_equal_estimates_show_no_significant_difference(tmp_path: Path) -> None:
    class Same(Icp):
        name: ClassVar[str] = "same"

    noisy = bulged_case(noise=0.5)
    folder = Pipeline([Icp(), Same()], folds=0).run(noisy).write(tmp_path / "run")
    subject = read_subject([folder])
    assert verdict(subject).startswith("No significant difference between same and icp on ")
    found = next(one for one in checks(subject) if one.name == "Against icp")
    assert (found.grade, found.short) == ("even", "no significant difference")
    passed = [one for one in checks(subject) if one.grade == "good"]
    assert f"{len(passed)} checks passed, 1 neutral" in overall([found, *passed], [])


def test_in_two_dimensions_the_strip_and_the_text_compare_alike(tmp_path: Path) -> None:
    subject = read_subject([finished_2d(tmp_path / "run")])
    found = next(one for one in checks(subject) if one.name == "Against icp")
    told = re.search(r"than icp by ([0-9.]+ \w+)", verdict(subject))
    assert told
    assert f"by {told[1]}" in found.short
    assert found.grade == ("good" if "closer" in found.short else "amber")
