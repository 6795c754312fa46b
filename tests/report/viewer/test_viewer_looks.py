"""How surfaces and points look: light leaves colours, surfaces fill their picture, points keep their size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.geometry.similarity import similarity
from o3dls.report.drawing.colour_maps import colour_table
from o3dls.report.writer import write_report
from tests.browser import Visit
from tests.finished import bulged_case, finished
from tests.viewer import FIXTURES, press, type_range

run, report, launch, browser, visit = FIXTURES


def without_marks(visit: Visit) -> None:
    for box in [*visit.page.locator("#kinds input").all(), visit.page.locator("#labels")]:
        box.uncheck()
    visit.page.uncheck("#hatched")
    visit.settle()


def covered(picture: Any) -> Any:
    """Where the surface is, without the words and bars at the lower edge."""
    there = picture[..., 3] > 250
    there[-60:] = False
    return there


def test_light_leaves_the_colours_of_a_wall_as_they_are(visit: Visit) -> None:
    """All of the wall has one value, so that all of it has to look so, but for the line at its edge."""
    without_marks(visit)
    type_range(visit, "1000", "2000")
    picture = visit.picture(1)
    seen = picture[covered(picture)][:, :3] / 255
    light = (seen / colour_table("sequential")[0]).mean(axis=1)
    line = light < 0.8
    assert line.mean() < 0.05
    assert np.percentile(light[~line], 1) > 0.84
    assert np.percentile(light, 20) > 0.93


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_folds_are_darker_but_no_colour_is_read_wrongly(
    share: float, run: Path, browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wall that faces nothing but wall has the least light that colours bear."""
    place = "o3dls.report.drawing.scene.occlusion"
    monkeypatch.setattr(place, lambda surface: np.full(len(surface.vertices), share))
    visit = Visit(browser, write_report([run], tmp_path / "page.html"))
    without_marks(visit)
    type_range(visit, "1000", "2000")
    picture = visit.picture(1)
    light = (picture[covered(picture)][:, :3] / 255 / colour_table("sequential")[0]).mean(axis=1)
    assert np.median(light) == pytest.approx(max(0.85, 0.99 - share / 2), abs=0.02)
    assert np.percentile(light, 8) > 0.84  # but for the line at the edge
    visit.page.close()


@pytest.mark.parametrize("width", [1440, 390])
def test_surfaces_fill_four_fifths_of_their_picture(
    launch: Callable[..., Any], report: Path, width: int
) -> None:
    visit = Visit(launch(), report, width=width)
    if width < 600:
        visit.page.get_by_text("More controls", exact=True).click()
    without_marks(visit)
    there = visit.picture(1)[..., 3] > 250
    middle = [slice(n * 2 // 5, n * 3 // 5) for n in there.shape]  # no words and no bars
    across, along = there[middle[0]].any(axis=0), there[:, middle[1]].any(axis=1)
    spans = [np.ptp(np.flatnonzero(one)) / len(one) for one in (across, along)]
    assert max(spans) == pytest.approx(0.8, abs=0.04)


def mark_width(visit: Visit) -> float:
    """Mean width of a lonely mark: the picture with points less that without."""
    with_points = visit.picture(0)
    visit.page.locator("#kinds input").first.uncheck()
    visit.settle()
    changed = (np.abs(with_points - visit.picture(0)).max(axis=2) > 20).sum()
    visit.page.locator("#kinds input").first.check()
    visit.settle()
    return float(changed)


def test_points_keep_their_size_when_one_zooms(tmp_path: Path, browser: Any) -> None:
    case = bulged_case(points=12)
    visit = Visit(browser, write_report([finished(tmp_path / "run", case)]))
    for box in visit.page.locator("#kinds input").all()[1:]:
        box.uncheck()
    visit.settle()
    before = mark_width(visit)
    visit.page.locator("#panels canvas").first.focus()
    visit.page.keyboard.press("-")
    visit.page.keyboard.press("-")
    visit.settle()
    assert mark_width(visit) == pytest.approx(before, rel=0.3)  # balls would cover half as much
    visit.page.close()


def test_a_crowd_of_points_is_thinned_out_and_all_are_there_when_one_zooms(
    tmp_path: Path, browser: Any
) -> None:
    visit = Visit(browser, write_report([finished(tmp_path / "run", bulged_case(points=4000))]))
    note = visit.page.locator("#thinned")
    assert "of 4020 points are drawn: zoom in for more" in note.inner_text()
    visit.page.locator("#panels canvas").first.focus()
    for _ in range(6):
        visit.page.keyboard.press("+")
    visit.settle()
    assert note.is_hidden()
    visit.page.close()


def test_a_view_from_which_more_is_seen_shows_all_of_it(tmp_path: Path, browser: Any) -> None:
    """A long chamber that the page opens across its end is not cut off when it is seen along its side."""
    case = bulged_case()
    longer = similarity(np.diag([1.0, 2.5, 1.0]), np.zeros(3))
    visit = Visit(browser, write_report([finished(tmp_path / "run", stretched(case, longer))]))
    without_marks(visit)
    press(visit, "LL")
    picture = visit.picture(1)[:-60]
    assert not (picture[:, [0, -1], 3] > 0).any()
    visit.page.close()


def stretched(case: Any, matrix: Any) -> Any:
    from dataclasses import replace

    points = replace(case.points, xyz=case.points.xyz @ matrix[:3, :3])
    marks = {name: at @ matrix[:3, :3] for name, at in case.prior_landmarks.items()}
    truth = replace(
        case.truth,
        surface=case.truth.surface.transformed(matrix),
        held_out=case.truth.held_out @ matrix[:3, :3],
    )
    return replace(
        case, prior=case.prior.transformed(matrix), points=points, prior_landmarks=marks, truth=truth
    )


def test_a_picture_without_the_chosen_colour_offers_one_that_has_it(
    visit: Visit, browser: Any, run: Path, tmp_path: Path
) -> None:
    """The other picture alone, and larger, or another estimate."""
    tall = visit.page.locator("#panels canvas").last.bounding_box()["height"]
    visit.page.select_option("#field", label="posterior standard deviation")
    press(visit, "One large picture")
    assert visit.page.locator("#panels figure:visible").count() == 1
    assert visit.page.locator("#panels canvas").last.bounding_box()["height"] > 1.2 * tall
    other = Visit(browser, write_report([run], tmp_path / "page.html", compare=("start", "icp")))
    other.page.select_option("#field", label="posterior standard deviation")
    other.page.get_by_role("button", name="Show level_set", exact=True).first.click()
    other.settle()
    assert other.page.locator("select.estimate").first.evaluate("one => one.selectedOptions[0].text") == (
        "level_set"
    )
    assert other.page.get_by_role("button", name="Show level_set").count() == 0
    assert other.page.get_by_role("button", name="One large picture").count() == 1
    other.page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_ghost_has_an_outline_in_the_colour_of_its_contour(browser: Any, report: Path, scheme: str) -> None:
    """A closed line: in nearly every row of the ghost there is some of it on either side. (The prior of this
    case lies within its surfaces.)
    """
    visit = Visit(browser, report, color_scheme=scheme)
    without_marks(visit)
    hex_ = visit.page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--ink').trim()")
    colour = np.array([int(hex_[k : k + 2], 16) for k in (1, 3, 5)])

    def drawn() -> Any:
        picture = visit.picture(0).astype(float)
        picture[-90:] = 0.0  # the cube and the bar
        return (np.abs(picture[..., :3] - colour).max(axis=-1) < 12) & (picture[..., 3] > 200)

    before = drawn()
    visit.page.select_option("#ghost", "truth")
    visit.settle()
    line = drawn() & ~before
    rows = np.flatnonzero(line.any(axis=1))
    assert len(rows) > 0.9 * np.ptp(rows) > 60
    sides = [np.ptp(np.flatnonzero(line[row])) for row in rows]
    assert np.median(sides) > 60
    visit.page.close()
