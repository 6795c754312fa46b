"""Every estimate is in the page, and two of them can share a picture."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from o3dls.report.drawing.estimates import MOST
from o3dls.report.drawing.scene import scene
from o3dls.report.subject import read_subject
from o3dls.report.writer import write_report
from tests.browser import Visit
from tests.finished import bulged_case, fine_sphere, finished
from tests.viewer import FIXTURES, SAME, press, rest

run, report, launch, browser, visit = FIXTURES


def test_every_estimate_is_in_the_page_and_equal_ones_once(run: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(run, tmp_path / "run"))
    equal = []
    for _ in range(2):
        made = scene(read_subject([folder], ["level_set"]))
        assert [one["name"] for one in made["estimates"]] == ["start", "icp", "level_set"]
        assert made["panels"] == [2]
        start, icp, *_ = (mesh["positions"] for mesh in made["meshes"])  # numbers of arrays
        equal.append(start == icp)
        shutil.copy(folder / "estimates/start/surface.ply", folder / "estimates/icp/surface.ply")
    assert equal == [False, True]


def test_estimates_that_wait_have_few_faces(tmp_path: Path) -> None:
    folder = finished(tmp_path / "run", replace(bulged_case(), prior=fine_sphere(36_000), truth=None))
    start = scene(read_subject([folder]))["estimates"][0]
    assert start["name"] == "start"
    full, drawn = (int(word) for word in start["caption"].split() if word.isdigit())
    assert full > 30_000
    assert drawn <= MOST


def test_before_and_after_share_a_picture(visit: Visit) -> None:
    """Left of the divider is the first picture, right of it the second, and the divider moves by keys."""
    press(visit, "Before / after")
    assert visit.page.locator("#panels figure:visible").count() == 2
    boxes = [visit.page.locator("#panels canvas").nth(k).bounding_box() for k in range(2)]
    assert boxes[0] == boxes[1]
    assert boxes[0]["width"] > 900  # all that contents and controls leave
    assert [visit.page.locator(f"#pair-{side} :checked").inner_text() for side in ("left", "right")] == [
        "start",
        "level_set",
    ]
    assert (
        visit.page.locator("#name-left").inner_text(),
        visit.page.locator("#name-right").inner_text(),
    ) == (
        "start",
        "level_set",
    )
    assert np.abs(visit.picture(0) - visit.picture(1)).mean() > 1
    divider = visit.page.get_by_role("slider", name="Divider of before and after")
    divider.focus()
    for key, value in (("ArrowRight", "52"), ("PageDown", "42"), ("Home", "0"), ("End", "100")):
        visit.page.keyboard.press(key)
        assert divider.get_attribute("aria-valuenow") == value
    assert divider.get_attribute("aria-valuetext") == "100 % start, 0 % level_set"
    assert not visit.page.locator("#name-right").is_visible()
    assert top(visit, 0.98) == top(visit, 0.02) == 0
    visit.page.keyboard.press("Home")
    assert top(visit, 0.98) == top(visit, 0.02) == 1


def top(visit: Visit, share: float) -> int:
    """Index of the picture that is seen at a share of the width of the pictures."""
    return int(
        visit.page.evaluate(
            """share => {
                const all = [...document.querySelectorAll('#panels canvas')];
                const box = all[0].getBoundingClientRect();
                all[0].scrollIntoView();
                const at = all[0].getBoundingClientRect();
                return all.indexOf(document.elementFromPoint(at.left + share * at.width, at.top + 60));
            }""",
            share,
        )
    )


def test_the_divider_is_dragged_and_pictures_return(visit: Visit) -> None:
    rest(visit)
    start = [visit.picture(k) for k in range(2)]
    press(visit, "Before / after")
    divider = visit.page.locator("#divider")
    divider.scroll_into_view_if_needed()
    box, wide = divider.bounding_box(), visit.page.locator("#panels canvas").first.bounding_box()
    y = box["y"] + box["height"] / 2
    visit.page.mouse.move(box["x"] + 14, y)
    visit.page.mouse.down()
    visit.page.mouse.move(wide["x"] + 0.25 * wide["width"], y, steps=4)
    visit.page.mouse.up()
    assert abs(int(divider.get_attribute("aria-valuenow")) - 25) <= 1
    assert (top(visit, 0.2), top(visit, 0.3)) == (0, 1)
    visit.page.select_option("#pair-left", label="icp")
    visit.settle()
    assert visit.page.locator("#name-left").inner_text() == "icp"
    press(visit, "Before / after")
    press(visit, "Reset")
    assert not divider.is_visible()
    assert (top(visit, 0.02), top(visit, 0.98)) == (0, 0)  # of the first picture, which is whole again
    rest(visit)
    for k in range(2):
        assert np.abs(visit.picture(k) - start[k]).mean() < SAME


def test_one_shown_estimate_can_be_compared_too(browser: Any, run: Path, tmp_path: Path) -> None:
    visit = Visit(browser, write_report([run], tmp_path / "one.html", compare=["level_set"]))
    assert visit.page.locator("#panels figure:visible").count() == 1
    press(visit, "Before / after")
    assert visit.page.locator("#panels figure:visible").count() == 2
    assert visit.page.locator("#name-left").inner_text() == "start"
    press(visit, "Before / after")
    assert visit.page.locator("#panels figure:visible").count() == 1
    assert visit.errors == []
    visit.page.close()


def test_names_at_the_divider_do_not_widen_the_page(browser: Any, report: Path) -> None:
    visit = Visit(browser, report, width=390, height=844)
    visit.page.get_by_text("More controls", exact=True).click()
    press(visit, "Before / after")
    visit.page.locator("#divider").focus()
    for key in ("End", "ArrowLeft"):
        visit.page.keyboard.press(key)
    assert visit.page.locator("#name-right").is_visible()
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= 390
    visit.page.close()


def at(visit: Visit, share: float) -> tuple[float, float]:
    """A place at a share of the width of the pair, at half of its height."""
    canvas = visit.page.locator("#panels canvas").first
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    return box["x"] + share * box["width"], box["y"] + box["height"] / 2


def test_each_half_is_read_and_measured_as_the_estimate_that_it_shows(visit: Visit) -> None:
    for box in visit.page.locator("#kinds input").all():
        box.uncheck()
    press(visit, "Before / after")
    readout = visit.page.locator("#readout")
    for share, name in ((0.45, "start"), (0.55, "level_set")):
        visit.page.mouse.click(*at(visit, share))
        visit.settle()
        assert readout.inner_text().startswith(f"{name}: ")
    press(visit, "Distance")
    for share in (0.45, 0.55):
        visit.page.mouse.click(*at(visit, share))
    visit.settle()
    measured = readout.inner_text()
    assert measured.startswith("Distance: ")
    assert measured.endswith(" mm")
    visit.page.select_option("#pair-right", label="icp")
    visit.settle()
    assert readout.inner_text() == measured  # what was pinned is gone, but not the distance
    visit.page.keyboard.press("Escape")
    assert readout.inner_text().startswith("Point at a surface")


def test_the_worst_points_are_those_of_the_right_half(visit: Visit) -> None:
    name = visit.page.locator("#worst-name")
    assert name.text_content() == "level_set"
    press(visit, "Before / after")
    visit.page.select_option("#pair-right", label="icp")
    assert name.text_content() == "icp"
    press(visit, "Before / after")
    assert name.text_content() == "level_set"


COUNTED = """() => new Promise((done) => {
    const seen = [], from = performance.now(), left = document.getElementById('name-left');
    const look = () => {
        seen.push(left.textContent);
        if (performance.now() - from < 2500) return setTimeout(look, 20);
        done([seen.filter((name, k) => k && name !== seen[k - 1]).length, performance.now() - from]);
    };
    look();
})"""


def test_flicker_alternates_slowly_and_only_when_asked(visit: Visit) -> None:
    press(visit, "Before / after")
    assert visit.page.evaluate(COUNTED)[0] == 0
    press(visit, "Flicker")
    changes, passed = visit.page.evaluate(COUNTED)
    assert 2 <= changes <= 3 * passed / 1000  # more than three a second could harm
    visit.page.emulate_media(reduced_motion="reduce")
    visit.settle()
    assert visit.page.evaluate(COUNTED)[0] == 0
    assert not visit.page.locator("#flicker").is_visible()
