"""The colour bars stand in the box of the pictures, and its legend says what hatching and grey mean."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.report.drawing.pictures import pictures
from o3dls.report.subject import read_subject
from o3dls.report.writer import write_report
from tests.browser import Visit
from tests.finished import bulged_case, finished
from tests.viewer import FIXTURES

run, report, launch, browser, visit = FIXTURES

BOXES = """() => {
    const box = (one) => {
        const { left, right, top, bottom } = one.getBoundingClientRect();
        return { left, right, top, bottom };
    };
    const bars = document.querySelector(".bars");
    const frame = bars.closest(".frame");
    return {
        frame: box(frame),
        paper: [frame, frame.firstElementChild].map((one) => getComputedStyle(one).backgroundColor),
        parts: [...frame.querySelectorAll(".bars, .bar canvas, .handle, .bar input, .bar button")].map(box),
        pictures: [...frame.querySelectorAll("#panels canvas")].map(box),
    };
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
def test_bars_and_handles_are_in_the_box_of_the_pictures_and_cover_none(
    browser: Any, report: Path, width: int, height: int, scheme: str
) -> None:
    seen = Visit(browser, report, width=width, height=height, color_scheme=scheme)
    found = seen.page.evaluate(BOXES)
    frame = found["frame"]
    assert found["paper"][0] == found["paper"][1]  # of one colour: one box
    assert len(found["pictures"]) == 2
    for part in found["parts"]:
        assert frame["left"] <= part["left"] <= part["right"] <= frame["right"] <= width
        assert frame["top"] <= part["top"] <= part["bottom"] <= frame["bottom"]
        for picture in found["pictures"]:
            assert part["top"] >= picture["bottom"] or part["left"] >= picture["right"]
    seen.page.close()


@pytest.fixture(scope="module")
def half(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose points lie on one side: the other is farther than 10 mm from all of them."""
    case = bulged_case(points=160)
    case = replace(case, truth=None, points=case.points.select(case.points.xyz[:, 2] > -6.0))
    return finished(tmp_path_factory.mktemp("half") / "run", case, folds=3)


@pytest.fixture
def halved(browser: Any, half: Path) -> Iterator[Visit]:
    opened = Visit(browser, write_report([half]))
    yield opened
    opened.page.close()


@pytest.mark.parametrize("colour", ["distance of left-out points", "no colour"])
def test_wall_without_points_is_hatched_also_where_the_colour_has_no_value(
    halved: Visit, colour: str
) -> None:
    page = halved.page
    page.select_option("#field", label=colour)
    for box in page.locator("#kinds input, #labels").all():
        box.uncheck()
    halved.settle()
    hatched = halved.picture(0)
    page.uncheck("#hatched")
    halved.settle()
    plain = halved.picture(0)
    changed = np.abs(hatched.astype(float) - plain).max(axis=-1) > 40  # of 255: lines that are seen
    rows, _ = np.nonzero(changed)
    assert changed.mean() > 0.02
    assert np.median(rows) > changed.shape[0] / 2  # below, where no points are
    grey = plain[changed][:, :3].astype(float)
    assert np.ptp(np.median(grey, axis=0)) < 8.0  # without a value: else another colour than grey


def test_the_legend_names_hatching_and_missing_values_where_there_are_any(halved: Visit) -> None:
    page = halved.page
    page.select_option("#field", label="distance of left-out points")

    def shown() -> list[bool]:
        return [page.locator(f"#{one}").is_visible() for one in ("means-hatched", "means-grey")]

    assert shown() == [True, True]
    assert page.locator("#wall-legend").inner_text().split("\n")[0].startswith("no points here")
    page.uncheck("#hatched")
    assert shown() == [False, True]
    page.select_option("#field", label="no colour")
    assert shown() == [False, False]
    page.check("#hatched")
    assert shown() == [True, False]


def test_each_bar_says_what_it_colours_and_that_left_out_points_are_no_error_of_the_surface(
    halved: Visit,
) -> None:
    page = halved.page
    page.select_option("#field", label="distance of left-out points")
    names = page.locator(".bar .name").all_inner_texts()
    assert names == ["wall: distance of left-out points, mm", "points: distance to the surface, mm"]
    note = page.locator("#surface-bar #of-left-out")
    assert "not the error of this surface" in note.inner_text()
    page.select_option("#field", label="posterior standard deviation")
    assert page.locator(".bar .name").first.inner_text().startswith("wall: posterior")
    assert not note.is_visible()


def test_the_legend_names_diamonds_where_points_are_judged_outliers(halved: Visit) -> None:
    page, diamond = halved.page, halved.page.locator("#means-diamond")
    assert diamond.is_visible()
    assert diamond.inner_text() == "point judged an outlier"
    page.locator("#kinds").get_by_label("outliers").uncheck()
    assert not diamond.is_visible()


def test_a_wall_full_of_points_needs_no_legend(visit: Visit) -> None:
    visit.page.select_option("#field", label="distance to truth")
    assert visit.page.locator("#means-grey").is_hidden()


def test_pictures_without_a_graphics_card_are_hatched_too(half: Path) -> None:
    subject = read_subject([half])
    drawn = pictures(subject)[subject.last.name]
    lower, upper = np.array_split(drawn.astype(float).mean(axis=2), 2)[::-1]
    steps = [np.abs(np.diff(part, axis=1))[np.abs(np.diff(part, axis=1)) < 120] for part in (lower, upper)]
    assert (steps[0] > 20).mean() > 2 * (steps[1] > 20).mean()


def test_the_border_of_wall_without_a_value_is_smooth_and_not_along_triangles(halved: Visit) -> None:
    """How far the border wanders from itself made smooth over 8 pixels, in its length."""
    from scipy.ndimage import binary_erosion, gaussian_filter

    page = halved.page
    page.select_option("#field", label="distance of left-out points")
    for box in page.locator("#kinds input, #labels, #hatched").all():
        box.uncheck()
    halved.settle()
    picture = halved.picture(0).astype(float)
    wall = picture[..., 3] > 250
    grey = wall & (np.ptp(picture[..., :3], axis=-1) < 12) & (picture[..., 0] > 120)
    assert 0.05 < grey.sum() / wall.sum() < 0.95
    inner = binary_erosion(wall, iterations=20)
    smooth = gaussian_filter(grey.astype(float), 8) > 0.5
    border = (smooth ^ binary_erosion(smooth)) & inner
    assert border.sum() > 100
    assert ((smooth ^ grey) & inner).sum() / border.sum() < 0.75
