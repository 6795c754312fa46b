"""Parts of the mapped wall that are worse than the rest are named, by places that a person finds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.arrays import Array
from o3dls.report.drawing.scene import scene
from o3dls.report.grading import doubts as doubts_module
from o3dls.report.grading.doubts import doubted_regions
from o3dls.report.grading.worse_parts import WorsePart, worse_parts
from o3dls.report.mapping.place_words import describe_place
from o3dls.report.sections.answers import answers
from o3dls.report.subject import Subject, read_subject
from tests.finished import bulged_case, finished, finished_2d

SEED = 141_421


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("worse") / "run", bulged_case(points=200), folds=3)


def with_gaps(subject: Subject, gaps: Array, weights: Array | None = None) -> Subject:
    """The subject with other distances (n,) of its left-out points, and beliefs in them."""
    last, run = subject.last, subject.last.run
    every = np.full(len(run.points), np.nan)
    every[run.points.type == "eam"] = gaps
    points = replace(run.points, columns={**run.points.columns, f"left_out_{last.key}_mm": every})
    estimate = last.estimate if weights is None else replace(last.estimate, weights=weights)
    changed = replace(run, points=points, estimates={**run.estimates, last.key: estimate})
    results = {name: replace(one, run=changed) for name, one in subject.results.items()}
    return replace(subject, results=results, runs=[changed])


def equal_gaps(subject: Subject) -> tuple[Array, Array]:
    """Positions of the points, and distances that are alike everywhere."""
    at = subject.last.run.points.of("eam").xyz
    return at, np.abs(np.random.default_rng(SEED).normal(size=len(at)))


def test_a_part_with_far_off_points_is_found_at_its_place_and_others_are_not(run: Path) -> None:
    subject = read_subject([run])
    at, gaps = equal_gaps(subject)
    assert worse_parts(with_gaps(subject, gaps)) == []
    near = np.linalg.norm(at - at[0], axis=1) < 8.0
    assert near.sum() >= 3
    (part,) = worse_parts(with_gaps(subject, np.where(near, 7.0, gaps)))
    assert np.linalg.norm(part.place - at[0]) < 10.0
    assert 4.0 < part.error <= 7.0
    assert part.known_by.endswith("left-out points")


def test_points_that_are_judged_outliers_make_no_part_worse(run: Path) -> None:
    subject = read_subject([run])
    at, gaps = equal_gaps(subject)
    near = np.linalg.norm(at - at[0], axis=1) < 8.0
    doubted = with_gaps(subject, np.where(near, 7.0, gaps), np.where(near, 0.01, 1.0))
    assert worse_parts(doubted) == []


@pytest.mark.parametrize(("height", "found"), [(1.5, 0), (5.0, 1)])
def test_a_part_of_mapped_wall_of_which_the_model_is_less_sure_is_found(
    run: Path, height: float, found: int
) -> None:
    subject = read_subject([run])
    last, surface = subject.last, subject.last.estimate.surface
    up = surface.vertices[:, 2] > 0.8 * surface.vertices[:, 2].max()
    fields = {**surface.fields, "sd_mm": np.where(up, height, 1.0), "prior_only": np.zeros(len(up))}
    estimate = replace(last.estimate, surface=replace(surface, fields=fields))
    changed = replace(last.run, estimates={**last.run.estimates, last.key: estimate})
    unsure = replace(subject, results={**subject.results, last.name: replace(last, run=changed)})
    parts = [one for one in worse_parts(unsure) if one.known_by == "by the model"]
    assert len(parts) == found
    for part in parts:
        assert part.place[2] > 0.8 * surface.vertices[:, 2].max()
        assert part.error == pytest.approx(0.798 * height, rel=0.01)
    everywhere = replace(surface, fields={**fields, "prior_only": np.ones(len(up))})
    estimate = replace(last.estimate, surface=everywhere)
    changed = replace(last.run, estimates={**last.run.estimates, last.key: estimate})
    unmapped = replace(subject, results={**subject.results, last.name: replace(last, run=changed)})
    assert not [one for one in worse_parts(unmapped) if one.known_by == "by the model"]


def test_the_worst_three_are_named_and_the_others_counted(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    subject = read_subject([run])
    places = subject.last.estimate.surface.vertices[::40][:5]
    parts = [WorsePart(place, 9.0 - k, "at 4 left-out points") for k, place in enumerate(places)]
    monkeypatch.setattr(doubts_module, "worse_parts", lambda _: parts)
    monkeypatch.setattr(type(subject), "unmapped", property(lambda _: 0.07))
    text = str(answers(subject, [])).split("Do not rely on")[1].split("</dd>")[0]
    assert text.count("left-out points)") == 3
    assert text.index("(9.0 mm at 4") < text.index("(8.0 mm at 4") < text.index("(7.0 mm at 4")
    assert text.endswith(" and 2 more; the 7% of the wall without points (hatched).")
    doubts = doubts_module.doubted_regions(subject, [])[:3]
    labels = [one["name"] for one in scene(subject, doubts)["doubts"]]
    assert labels == ["9.0 mm", "8.0 mm", "7.0 mm"]  # a picture's label is found in the words


def test_in_2d_no_part_is_named(tmp_path: Path) -> None:
    assert worse_parts(read_subject([finished_2d(tmp_path / "flat")])) == []


@pytest.mark.parametrize(
    ("step", "words"),
    [
        ((0.0, 0.0, -12.0), "12 mm below RSPV"),
        ((0.0, 12.0, 0.0), "12 mm behind RSPV"),
        ((10.0, 0.0, 0.0), "10 mm left of RSPV"),
        ((-3.0, -8.0, 8.0), "12 mm in front of and above RSPV"),
        ((0.0, 0.0, 2.0), "at RSPV"),
    ],
)
def test_a_place_has_a_direction_by_the_patients_axes(
    run: Path, step: tuple[float, float, float], words: str
) -> None:
    """The frame is LPS: y leads to the back."""
    subject = read_subject([run])
    mark = np.array([0.0, 0.0, 20.0])
    assert describe_place(subject, mark + np.array(step)) == words


def test_where_the_patients_axes_are_unknown_the_direction_is_by_the_priors(tmp_path: Path) -> None:
    case = bulged_case()
    marks = {f"L{k}": at for k, at in enumerate(case.prior_landmarks.values())}
    given = case.points.columns["name"]
    names = np.array([f"L{list(case.prior_landmarks).index(name)}" if name else "" for name in given])
    points = replace(case.points, columns={**case.points.columns, "name": names})
    case = replace(case, prior_landmarks=marks, points=points, frame="unknown")
    subject = read_subject([finished(tmp_path / "run", case)])
    place = np.array([0.0, 20.0, 0.0]) + np.array([-9.0, 0.0, 8.0])
    assert describe_place(subject, place) == "12 mm from L0 towards prior −x, +z"


def test_without_landmarks_a_place_has_no_words_and_a_doubt_has_coordinates(tmp_path: Path) -> None:
    case = bulged_case(points=200)
    case = replace(case, prior_landmarks={}, points=case.points.of("eam", "ablation"))
    subject = read_subject([finished(tmp_path / "run", case, folds=3)])
    assert describe_place(subject, np.zeros(3)) == ""
    at, gaps = equal_gaps(subject)
    near = np.linalg.norm(at - at[0], axis=1) < 8.0
    (doubt,) = doubted_regions(with_gaps(subject, np.where(near, 7.0, gaps)), [])
    place = ", ".join(f"{x:.0f}" for x in doubt.place)
    assert doubt.name == f"around ({place})"
