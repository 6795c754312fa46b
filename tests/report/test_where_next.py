"""Where to map next, and regions: in the page, in its pictures, and on the command line."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from scipy.spatial import cKDTree

from o3dls import Case, Deform, InputError, Pipeline, Points
from o3dls.cli.commands import cli
from o3dls.evaluation.regions import REGIONS, openings, valve_of
from o3dls.report.drawing.scene import scene
from o3dls.report.expected import FEWEST
from o3dls.report.mapping.advice import shown_advice
from o3dls.report.mapping.sections import next_section, region_section
from o3dls.report.mapping.wall_regions import advised, landmarks_in_map
from o3dls.report.page import report_page
from o3dls.report.subject import Subject, read_subject
from tests.browser import Visit, chromium
from tests.chamber import chamber, measured
from tests.fields import body
from tests.finished import bulged_case, finished, finished_2d

SEED = 577_215


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sparse map of a chamber that was stretched since it was imaged."""
    case = measured(chamber(20), np.diag([1.0, 1.15, 0.95, 1.0]), 60, noise=1.0)
    run = Pipeline([Deform()], folds=0).run(replace(case, frame="LPS"))
    return run.write(tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture(scope="module")
def subject(folder: Path) -> Subject:
    return read_subject([folder])


@pytest.fixture(scope="module")
def without(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose motion has no joint posterior."""
    return finished(tmp_path_factory.mktemp("runs") / "without")


def said(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["next", *map(str, arguments)])


def test_the_section_has_a_row_for_each_number_in_the_pictures(subject: Subject) -> None:
    section = next_section(subject)
    found = shown_advice(subject)
    assert section is not None
    assert found is not None
    assert 1 <= len(found.places) <= 3
    numbers = re.findall(r'<th scope="row">(\d)</th>', section.body)
    drawn = scene(subject)["next"]
    assert numbers == [one["name"] for one in drawn]
    assert [one["at"] for one in drawn] == [place.xyz.tolist() for place in found.places]
    assert "not advice for a procedure" in section.body
    assert 'id="next"' in report_page(subject)


@pytest.mark.parametrize("width", [1440, 390])
def test_what_a_place_gains_is_seen_on_the_first_screen_and_in_the_table(
    browser: Any, subject: Subject, tmp_path: Path, width: int
) -> None:
    """Without scrolling aside, and as one value: before and with a point."""
    found = shown_advice(subject)
    assert found is not None
    gains = [f"{one.near_before:.2f} → {one.near_after:.2f}" for one in found.places]
    path = tmp_path / "report.html"
    path.write_text(report_page(subject), encoding="utf-8")
    visit = Visit(browser, path, width=width, height=844)
    answer = visit.page.locator(".answers dd").last
    assert f"error there {gains[0]} mm)" in answer.inner_text()
    box = answer.bounding_box()
    assert box["y"] + box["height"] < 844
    visit.page.locator("#next").scroll_into_view_if_needed()
    visit.settle()
    for k, gain in enumerate(gains):
        cell = visit.page.locator("#next tbody tr").nth(k).get_by_text(gain, exact=True)
        box = cell.bounding_box()
        assert 0 <= box["x"] <= box["x"] + box["width"] <= width
        assert cell.evaluate("one => one.scrollWidth <= one.clientWidth")
    visit.page.close()


def test_without_a_posterior_there_is_no_advice(without: Path) -> None:
    subject = read_subject([without])
    assert next_section(subject) is None
    assert scene(subject)["next"] == []
    assert 'id="next"' not in report_page(subject)


def test_the_table_of_regions_adds_up(subject: Subject) -> None:
    section = region_section(subject)
    assert section is not None
    rows = re.findall(r"<tr><th scope=\"row\">(.*?)</th>(.*?)</tr>", section.body)
    assert {"roof", "floor", "posterior", "ostium LSPV"} < {name for name, _ in rows}
    cells = [re.findall(r"<td>(.*?)</td>", row) for _, row in rows]
    assert sum(float(row[0]) for row in cells) == pytest.approx(100.0, abs=0.1 * len(rows))  # as written
    assert sum(int(row[1]) for row in cells) == (subject.case.points.type == "eam").sum()


def test_a_region_of_few_points_says_so_instead_of_a_number(subject: Subject) -> None:
    points = subject.last.run.points
    eam = points.type == "eam"
    key = f"{subject.last.key}_mm"
    columns = {
        f"left_out_{key}": np.where(eam, 3.0, np.nan),
        f"left_out_sd_{key}": np.where(eam, 2.0, np.nan),
    }
    run = replace(subject.last.run, points=replace(points, columns={**points.columns, **columns}))
    results = {**subject.results, subject.last.name: replace(subject.last, run=run)}
    section = region_section(replace(subject, results=results, runs=[run]))
    assert section is not None
    rows = re.findall(r"<tr><th scope=\"row\">.*?</th>(.*?)</tr>", section.body)
    cells = [re.findall(r"<td>(.*?)</td>", row) for row in rows]
    assert {(int(row[1]) >= FEWEST, row[5]) for row in cells if row[1] != "0"} == {
        (True, "1.50"),
        (False, "too few points"),
    }
    assert {row[2] for row in cells if 0 < int(row[3]) < FEWEST} == {"too few points"}
    assert "too few points" not in {row[2] for row in cells if int(row[3]) >= FEWEST}


def test_the_pictures_have_the_regions_as_whole_numbers(subject: Subject) -> None:
    made = scene(subject)
    field = next(one for one in made["fields"] if one["key"] == "region")
    assert field["names"][4] == "roof"
    assert not next(one for one in made["fields"] if one["key"] != "region")["names"]
    assert "region" in made["meshes"][0]["fields"]
    assert "region" not in subject.surfaces["deform"].fields  # nowhere but in the pictures


def test_regions_need_three_dimensions_and_veins(tmp_path: Path) -> None:
    assert region_section(read_subject([finished_2d(tmp_path / "flat")])) is None
    case = bulged_case()
    bare = replace(case, points=case.points.of("eam", "ablation"), prior_landmarks={})
    assert region_section(read_subject([finished(tmp_path / "bare", bare)])) is None


def test_landmarks_of_the_prior_alone_come_along(subject: Subject) -> None:
    case = subject.case
    prior = {**case.prior_landmarks, "LAA": case.prior.vertices[0]}
    run = replace(subject.last.run, case=replace(case, prior_landmarks=prior))
    last = replace(subject.last, run=run)
    found = landmarks_in_map(replace(subject, results={**subject.results, subject.shown[-1]: last}))
    # the surface is interpolated from the motion at its nodes: to a hundredth
    assert np.allclose(found["LAA"], subject.last.estimate.surface.vertices[0], atol=0.05)
    marks = case.points.of("landmark")
    assert np.array_equal(found["LSPV"], marks.xyz[list(marks.columns["name"]).index("LSPV")])


def test_no_place_is_in_the_valve_that_a_landmark_names(subject: Subject) -> None:
    case, estimate = subject.case, subject.last.estimate
    first = advised(case, estimate, 1).places[0].xyz
    named = replace(case, prior_landmarks={}, points=with_mark(case.points, "MV", first))
    places = advised(named, estimate, 3).places
    valve = valve_of(estimate.surface, {"MV": first})
    assert places
    assert not any(valve[one.vertex] for one in places)


def test_a_named_vein_without_a_point_has_a_place(subject: Subject) -> None:
    """Though the posterior would ask for none: what nobody saw may be anywhere."""
    case, estimate = subject.case, subject.last.estimate
    of = openings(estimate.surface, landmarks_in_map(subject))
    vein = REGIONS.index("LIPV")
    inside = of[cKDTree(estimate.surface.vertices).query(case.points.xyz)[1]] == vein
    left = replace(case, points=case.points.select(~inside | (case.points.type == "landmark")))
    for one, expected in ((case, False), (left, True)):
        places = advised(one, estimate, 9).places
        assert any(of[place.vertex] == vein for place in places) == expected


def with_mark(points: Points, name: str, at: Any) -> Points:
    names = np.array([*points.columns["name"], name])
    return Points(np.vstack([points.xyz, at]), np.array([*points.type, "landmark"]), {"name": names})


def test_the_command_prints_lines_that_a_terminal_holds(folder: Path) -> None:
    done = said(folder, "--k", 2)
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert "frame of the map: LPS" in lines[0]
    assert [line[:3] for line in lines if line[:1].isdigit()] == ["1  ", "2  "]
    assert re.search(r"\d+ mm (left|right|in front|behind|above|below)", lines[1])
    assert "error around" in lines[2]
    assert max(map(len, lines)) <= 80
    assert "Research use only" in done.output.replace("\n", " ")


def test_the_command_prints_json(folder: Path, subject: Subject) -> None:
    found = json.loads(said(folder, "--json").output)
    assert (found["units"], found["frame"], found["estimate"]) == ("mm", "LPS", "deform")
    first = found["places"][0]
    vertex = subject.last.estimate.surface.vertices[first["vertex"]]
    assert first["xyz"] == pytest.approx(vertex.tolist())
    assert first["after"] < first["before"]
    assert first["landmark"]
    assert first["where"].endswith(first["landmark"])


def test_the_command_heeds_what_is_reachable(folder: Path, subject: Subject, tmp_path: Path) -> None:
    left = subject.last.estimate.surface.vertices[:, 0] > 0
    mask = tmp_path / "mask.csv"
    mask.write_text("reachable\n" + "\n".join(map(str, left.astype(int))), encoding="utf-8")
    found = json.loads(said(folder, "--json", "--reachable", mask).output)
    assert found["places"]
    assert all(place["xyz"][0] > 0 for place in found["places"])


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        (lambda n: ["1"] * (n - 1), "the surface of deform has"),
        (lambda n: ["0.5"] * n, "has 0.5: must be 0 or 1"),
        (lambda n: ["0"] * n, "has no 1"),
    ],
)
def test_a_mask_that_does_not_fit_is_refused(
    folder: Path, subject: Subject, tmp_path: Path, rows: Any, sentence: str
) -> None:
    mask = tmp_path / "mask.csv"
    n = len(subject.last.estimate.surface.vertices)
    mask.write_text("reachable\n" + "\n".join(rows(n)), encoding="utf-8")
    done = said(folder, "--reachable", mask)
    assert isinstance(done.exception, InputError)
    assert sentence in str(done.exception)


def test_the_command_says_what_a_run_without_posterior_lacks(without: Path) -> None:
    done = said(without)
    assert isinstance(done.exception, InputError)
    assert "run a pipeline with the stage 'deform'" in str(done.exception)


def test_an_outline_in_pixels_has_places_too(tmp_path: Path) -> None:
    outline = body(2)
    points = (outline.vertices * [1.15, 0.95])[:75:5]
    points += np.random.default_rng(SEED).normal(size=points.shape)
    case = Case("outline", outline, Points(points, np.full(len(points), "eam")), units="px")
    folder = Pipeline([Deform()], folds=0).run(case).write(tmp_path / "run")
    found = json.loads(said(folder, "--json").output)
    assert found["units"] == "px"
    assert len(found["places"][0]["xyz"]) == 2
    section = next_section(read_subject([folder]))
    assert section is not None
    assert "Lengths in px" in section.body
    assert "pictures" not in section.body  # which have no numbers in 2D


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as launch:
        yield launch()


def test_the_viewer_names_regions_and_takes_numbers_away(
    browser: Any, subject: Subject, tmp_path: Path
) -> None:
    path = tmp_path / "report.html"
    path.write_text(report_page(subject), encoding="utf-8")
    visit = Visit(browser, path)
    page = visit.page
    with_numbers = page.locator("#panels").screenshot()
    page.get_by_label("next places").uncheck()
    visit.settle()
    assert page.locator("#panels").screenshot() != with_numbers
    assert page.locator("#region-names").inner_text() == ""
    page.select_option("#field", "region")
    names = page.locator("#region-names span").all_inner_texts()
    assert names[0] == "lateral"
    assert "ostium RIPV" in names
    assert page.locator("#surface-bar").is_hidden()
    page.select_option("#field", "sd_mm")
    assert page.locator("#surface-bar").is_visible()
    assert page.locator("#region-names span").count() == 0
    assert not visit.errors
