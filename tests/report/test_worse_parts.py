"""Parts of the mapped wall that are worse than the rest are named, by places that a person finds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from o3dls.report.drawing.scene import scene
from o3dls.report.grading import doubts as doubts_module
from o3dls.report.grading.doubts import doubted_regions
from o3dls.report.grading.worse_parts import WorsePart, worse_parts
from o3dls.report.mapping.place_words import describe_place
from o3dls.report.sections.answers import answers
from o3dls.report.subject import read_subject
from tests.finished import bulged_case, finished, finished_2d


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("worse") / "run", bulged_case(points=200), folds=3)


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
    parts = worse_parts(unsure)
    assert len(parts) == found
    for part in parts:
        assert part.place[2] > 0.8 * surface.vertices[:, 2].max()
        assert part.error == pytest.approx(0.798 * height, rel=0.01)
    everywhere = replace(surface, fields={**fields, "prior_only": np.ones(len(up))})
    estimate = replace(last.estimate, surface=everywhere)
    changed = replace(last.run, estimates={**last.run.estimates, last.key: estimate})
    unmapped = replace(subject, results={**subject.results, last.name: replace(last, run=changed)})
    assert worse_parts(unmapped) == []


def test_the_worst_three_are_named_and_the_others_counted(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    subject = read_subject([run])
    places = subject.last.estimate.surface.vertices[::40][:5]
    parts = [WorsePart(place, 9.0 - k) for k, place in enumerate(places)]
    monkeypatch.setattr(doubts_module, "worse_parts", lambda _: parts)
    monkeypatch.setattr(type(subject), "unmapped", property(lambda _: 0.07))
    text = str(answers(subject, [])).split("Do not rely on")[1].split("</dd>")[0]
    assert text.count("by the model)") == 3
    assert text.index("(9.0 mm by") < text.index("(8.0 mm by") < text.index("(7.0 mm by")
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


def test_without_landmarks_a_place_has_no_words_and_a_doubt_has_coordinates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = bulged_case(points=200)
    case = replace(case, prior_landmarks={}, points=case.points.of("eam", "ablation"))
    subject = read_subject([finished(tmp_path / "run", case, folds=3)])
    assert describe_place(subject, np.zeros(3)) == ""
    part = WorsePart(subject.last.estimate.surface.vertices[7], 7.0)
    monkeypatch.setattr(doubts_module, "worse_parts", lambda _: [part])
    (doubt,) = doubted_regions(subject, [])
    place = ", ".join(f"{x:.0f}" for x in part.place)
    assert doubt.name == f"around ({place})"
