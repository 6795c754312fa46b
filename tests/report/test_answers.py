"""What the first screen answers below the verdict: how far off, where not to rely on it, what to do next."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.evaluation.next_places import MEAN_OVER_SD
from o3dls.evaluation.regions import REGIONS, short_word, word
from o3dls.report.grading import doubts as doubts_module
from o3dls.report.grading import expected_error as grading
from o3dls.report.grading.check import Check
from o3dls.report.grading.expected_error import contradicted_regions
from o3dls.report.page_parts import asset
from o3dls.report.sections.answers import answers
from o3dls.report.subject import Subject, read_subject
from o3dls.report.verdict import verdict
from o3dls.report.wall_parts import wall_parts
from o3dls.report.writer import write_report
from tests.browser import Visit, chromium
from tests.finished import bulged_case, finished, finished_2d

OK = Check("Valid surface", "good", "valid", "valid")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("answers") / "run", folds=3)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as launch:
        yield launch()


def said(subject: Subject, *found: Check) -> Mapping[str, str]:
    """The answers by their names."""
    text = str(answers(subject, found or (OK,)))
    return dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", text))


def with_fields(subject: Subject, sd: float, far: Any) -> Subject:
    """The subject with a deviation, and with its wall without points."""
    last = subject.last
    surface = last.estimate.surface
    count = len(surface.vertices)
    fields = {**surface.fields, "sd_mm": np.full(count, sd), "prior_only": np.broadcast_to(far, count) + 0.0}
    estimate = replace(last.estimate, surface=replace(surface, fields=fields))
    run = replace(last.run, estimates={**last.run.estimates, last.key: estimate})
    return replace(subject, results={**subject.results, last.name: replace(last, run=run)}, runs=[run])


def test_the_answers_stand_under_the_verdict_in_their_order(run: Path, browser: Any) -> None:
    for width, height in ((1440, 900), (390, 844)):
        visit = Visit(browser, write_report([run]), width=width, height=height)
        order = visit.page.evaluate(
            "[...document.querySelectorAll('h1, .overall, .answers dt, #panels canvas')]"
            ".map((one) => [one.innerText?.split(' ')[0] ?? '', one.getBoundingClientRect().top])"
        )
        tops = [top for _, top in order]
        assert [name for name, _ in order][2:5] == ["Typical", "Do", "Next"]
        assert tops == sorted(tops)
        assert tops[5] < height
        visit.page.close()


def test_measured_error_of_the_mapped_wall_is_not_hidden_by_a_smaller_one_of_the_model(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    subject = read_subject([run])
    monkeypatch.setattr(type(subject), "unmapped", property(lambda _: 0.5))
    mapped, unmapped = wall_parts(subject)
    assert mapped.found is not None
    assert unmapped.found is not None
    told = said(with_fields(subject, 0.1, np.arange(len(subject.last.estimate.surface.vertices)) % 2))
    assert (
        f"mapped wall {mapped.found:.1f} mm (measured, {mapped.n} held out points)" in told["Typical error"]
    )
    assert "unmapped wall 0.1 mm (by the model)" in told["Typical error"]
    larger = said(with_fields(subject, 9.0, 0.0))["Typical error"]
    assert re.search(rf"mapped wall \d+\.\d mm \(by the model, more than the {mapped.found:.1f} meas", larger)
    found = wall_parts(with_fields(subject, 9.0, 0.0))[0].found
    assert found is not None
    alike = said(with_fields(subject, (found + 1e-6) / MEAN_OVER_SD, 0.0))["Typical error"]
    assert alike.startswith(f"mapped wall {found:.1f} mm (measured")  # "1.1, more than 1.1" says nothing


@pytest.mark.parametrize(("share", "given"), [(0.004, False), (0.006, True)])
def test_no_error_is_given_of_unmapped_wall_that_rounds_to_nothing(
    run: Path, monkeypatch: pytest.MonkeyPatch, share: float, given: bool
) -> None:
    far = np.arange(len(read_subject([run]).last.estimate.surface.vertices)) == 0
    subject = with_fields(read_subject([run]), 2.0, far)
    monkeypatch.setattr(type(subject), "unmapped", property(lambda _: share))
    assert ("unmapped wall" in said(subject)["Typical error"]) == given


@pytest.mark.parametrize(("gap", "bound"), [(1.4, ""), (1.6, "at least ")])
def test_where_left_out_points_contradict_the_model_its_error_of_unmapped_wall_is_a_lower_bound(
    run: Path, monkeypatch: pytest.MonkeyPatch, gap: float, bound: str
) -> None:
    subject = read_subject([run])
    surface = subject.last.estimate.surface
    subject = with_fields(subject, 2.0, surface.vertices[:, 0] <= 0)
    points, key = subject.last.run.points, f"{subject.last.key}_mm"
    points.columns[f"left_out_{key}"] = np.full(len(points), gap)
    points.columns[f"left_out_sd_{key}"] = np.ones(len(points))
    of = np.where(surface.vertices[:, 0] > 0, REGIONS.index("roof"), REGIONS.index("tube"))
    monkeypatch.setattr(doubts_module, "wall_regions", lambda *_: of)
    monkeypatch.setattr(doubts_module, "contradicted_regions", lambda _: {})
    monkeypatch.setattr(type(subject), "unmapped", property(lambda _: 0.5))
    told = said(subject)
    assert f"unmapped wall {bound}1.6 mm (by the model)" in told["Typical error"]
    assert f"(no points, {bound}1.6 mm by the model)" in told["Do not rely on"]


def test_in_pictures_a_doubt_has_a_name_that_is_not_cut(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    most = int(re.search(r"LONGEST = (\d+)", asset("labels.js"))[1])  # type: ignore[index]
    for k in range(len(REGIONS)):
        assert len(short_word(k)) <= most
    subject = read_subject([run])
    of = np.full(len(subject.last.estimate.surface.vertices), REGIONS.index("tube"))
    monkeypatch.setattr(doubts_module, "wall_regions", lambda *_: of)
    (doubt,) = doubts_module.doubted_regions(with_fields(subject, 2.0, 1.0), [OK])
    assert doubt.label == "no landmark"
    assert doubt.name == word(REGIONS.index("tube"))  # in words there is room


@pytest.mark.parametrize(("share", "told"), [(0.003, "no part in particular."), (0.02, "the 2% of the wall")])
def test_a_share_of_the_wall_that_rounds_to_nothing_is_not_named(
    run: Path, monkeypatch: pytest.MonkeyPatch, share: float, told: str
) -> None:
    subject = with_fields(read_subject([run]), 2.0, 0.0)
    monkeypatch.setattr(type(subject), "unmapped", property(lambda _: share))
    assert said(subject)["Do not rely on"].startswith(told)


def test_a_region_that_points_contradict_is_named_before_one_without_points(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    subject = with_fields(read_subject([run]), 2.0, 0.0)
    assert said(subject)["Do not rely on"] == "no part in particular."
    surface = subject.last.estimate.surface
    of = np.where(surface.vertices[:, 0] > 0, REGIONS.index("RIPV"), REGIONS.index("LAA"))
    subject = with_fields(subject, 2.0, surface.vertices[:, 0] <= 0)
    points = subject.last.run.points
    key = f"{subject.last.key}_mm"
    points.columns[f"left_out_{key}"] = np.where(points.xyz[:, 0] > 0, 6.0, 0.1)
    points.columns[f"left_out_sd_{key}"] = np.ones(len(points))
    for module in (grading, doubts_module):
        monkeypatch.setattr(module, "wall_regions", lambda *_: of)
    one = contradicted_regions(subject)[REGIONS.index("RIPV")]
    assert one.distance > 5.0
    told = said(subject)["Do not rely on"]
    first = f"ostium RIPV ({one.distance:.1f} mm at {one.count} left-out points)"
    assert told == f"{first}; appendage (no points, at least 1.6 mm by the model)."
    bad = Check("Far points", "bad", "far", "far")
    assert said(subject, bad)["Do not rely on"] == "the whole surface: a check failed."
    assert doubts_module.doubted_regions(subject, [bad]) == []
    for doubt, right in zip(doubts_module.doubted_regions(subject, [OK]), (True, False), strict=True):
        place = np.flatnonzero((surface.vertices == doubt.place).all(axis=1))
        assert (surface.vertices[place, 0] > 0).tolist() == [right]
        assert np.linalg.norm(doubt.place[1:]) < 0.3 * abs(doubt.place[0])


def test_next_names_what_to_mark_and_where_to_map(run: Path) -> None:
    subject = read_subject([run])
    amber = Check("Landmarks", "amber", "far", "LSPV 17.0 mm")
    assert said(subject, amber)["Next"].startswith("mark LSPV again")
    assert subject.first is not None
    behind = Check(f"Against {subject.first.name}", "amber", "farther", "farther by 0.21 mm")
    assert said(subject, behind)["Next"] == f"see whether {subject.first.name} is the better surface here."
    assert said(subject, OK)["Next"] == "nothing is asked for."  # this motion has no joint posterior
    bad = Check("Size", "bad", "scale", "x 2")
    assert "find out why this failed: Size; check units" in said(subject, bad)["Next"]


def test_left_out_points_test_the_models_error_without_their_own_noise(tmp_path: Path) -> None:
    case = replace(bulged_case(), truth=None, points=bulged_case().points.of("eam"))
    subject = with_fields(read_subject([finished(tmp_path / "run", case, folds=3)]), 0.5, 0.0)
    assert subject.headline == "cross_validated"
    points = subject.last.run.points
    key = f"{subject.last.key}_mm"
    points.columns[f"left_out_sd_{key}"] = np.ones(len(points))
    # 1 mm off where 1 mm, most of it noise, is predicted: the wall's own error is the model's
    points.columns[f"left_out_{key}"] = np.ones(len(points))
    told = said(subject)["Typical error"]
    assert told.startswith("mapped wall 0.4 mm (by the model, which ")
    own = 0.6 * np.sqrt(2 / np.pi)
    assert told.endswith(f"bear out; the noise of the points, {own:.1f} mm, is in the colours).")
    assert grading.check_expected_error(subject).short == "0.4 mm, mapped wall"
    assert f"The points' own noise, about {own:.2f} mm in the mean, is in these" in verdict(subject)
    points.columns[f"left_out_{key}"] = np.full(len(points), 3.0)
    told = said(subject)["Typical error"]
    assert told.startswith("mapped wall 1.2 mm (3.0 times what the model expects, as ")
    assert grading.check_expected_error(subject).short == "1.2 mm, mapped wall, contradicted"


def test_without_points_left_out_the_error_is_the_models_and_folds_are_asked_for(tmp_path: Path) -> None:
    case = replace(bulged_case(), truth=None, points=bulged_case().points.of("eam"))
    subject = read_subject([finished(tmp_path / "run", case)])
    told = said(with_fields(subject, 1.0, 0.0))
    assert told["Typical error"] == "mapped wall 0.8 mm (by the model)."
    assert told["Next"] == "cross-validate (folds = 5)."
    assert "measured, " in said(read_subject([finished_2d(tmp_path / "flat")]))["Typical error"]
