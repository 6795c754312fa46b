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
from o3dls.report.mapping import place_words
from o3dls.report.mapping.place_words import describe_place, name_place
from o3dls.report.sections.answers import answers
from o3dls.report.subject import read_subject
from tests.finished import bulged_case, finished, finished_2d


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("worse") / "run", bulged_case(points=200), folds=3)


@pytest.mark.parametrize(
    ("height", "rest", "found"), [(3.0, 2.0, 0), (5.0, 1.0, 1), (2.4, 0.3, 0), (2.6, 0.3, 1)]
)
def test_a_part_of_mapped_wall_of_which_the_model_is_less_sure_is_found(
    run: Path, height: float, rest: float, found: int
) -> None:
    """Also where the rest is surer still, an error below the width of a catheter's tip is not named."""
    subject = read_subject([run])
    last, surface = subject.last, subject.last.estimate.surface
    up = surface.vertices[:, 2] > 0.8 * surface.vertices[:, 2].max()
    fields = {**surface.fields, "sd_mm": np.where(up, height, rest), "prior_only": np.zeros(len(up))}
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
    assert text.index("place A, ") < text.index("(9.0 mm by") < text.index("; place B, ")
    labels = [one["name"] for one in scene(subject, doubts)["doubts"]]
    assert labels == ["A: 9.0 mm", "B: 8.0 mm", "C: 7.0 mm"]  # a picture's label is found in the words


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


@pytest.mark.parametrize(
    ("step", "region", "words"),
    [
        ((-3.0, -8.0, 8.0), "roof", "roof, 12 mm in front of RSPV"),
        ((-3.0, -8.0, 8.0), "ostium RSPV", "ostium RSPV, 12 mm in front"),
        ((10.0, 0.0, 0.0), "ostium RSPV", "ostium RSPV, 10 mm left"),
        ((0.0, 0.0, 2.0), "ostium RSPV", "ostium RSPV"),
        ((0.0, 0.0, 2.0), "", "at RSPV"),
    ],
)
def test_on_the_first_screen_a_place_has_one_direction_and_each_landmark_is_named_once(
    run: Path, step: tuple[float, float, float], region: str, words: str
) -> None:
    mark = np.array([0.0, 0.0, 20.0])
    assert name_place(read_subject([run]), mark + np.array(step), region) == words


@pytest.mark.parametrize(
    ("step", "words"),
    [
        ((0.0, 0.0, -12.0), "12 mm from L0, towards L1"),
        ((0.0, 0.0, 12.0), "12 mm from L0, away from L1"),
        ((0.0, -14.0, 2.0), "14 mm from L0, towards L2"),
        ((12.0, 0.0, 0.0), "12 mm from L0 and 42 mm from L1"),
        ((0.0, 2.0, 0.0), "at L0"),
    ],
)
def test_where_the_patients_axes_are_unknown_a_place_is_named_by_two_landmarks(
    run: Path, monkeypatch: pytest.MonkeyPatch, step: tuple[float, float, float], words: str
) -> None:
    marks = {"L0": (0.0, 0.0, 20.0), "L1": (0.0, 0.0, -20.0), "L2": (0.0, -50.0, 20.0)}
    placed = {name: np.array(at) for name, at in marks.items()}
    monkeypatch.setattr(place_words, "landmarks_in_map", lambda _: placed)
    subject = read_subject([run])
    points = subject.case.points.of("eam")
    unknown = replace(subject.case, frame="unknown", prior_frame="unknown", points=points)
    last = replace(subject.last, run=replace(subject.last.run, case=unknown))
    unaware = replace(subject, results={subject.last.name: last})
    assert describe_place(unaware, placed["L0"] + np.array(step)) == words
    assert name_place(unaware, placed["L0"] + np.array(step), "") == words.split(" and ")[0]
    monkeypatch.setattr(place_words, "landmarks_in_map", lambda _: {"L0": placed["L0"]})
    assert describe_place(unaware, placed["L0"] + 12 * np.eye(3)[0]) == "12 mm from L0"


def test_without_landmarks_a_doubt_is_named_by_its_letter_in_the_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = bulged_case(points=200)
    case = replace(case, prior_landmarks={}, points=case.points.of("eam", "ablation"))
    subject = read_subject([finished(tmp_path / "run", case, folds=3)])
    assert describe_place(subject, np.zeros(3)) == ""
    places = subject.last.estimate.surface.vertices[[7, 90]]
    parts = [WorsePart(place, error) for place, error in zip(places, (7.0, 6.0), strict=True)]
    monkeypatch.setattr(doubts_module, "worse_parts", lambda _: parts)
    doubts = doubted_regions(subject, [])
    assert [one.name for one in doubts] == ["place A", "place B"]
    assert [one["name"] for one in scene(subject, doubts)["doubts"]] == ["A: 7.0 mm", "B: 6.0 mm"]
