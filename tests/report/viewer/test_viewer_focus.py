"""What has the wheel and the fingers, the whole screen, and labels behind the wall."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.report.grading.doubts import Doubt
from o3dls.report.writer import write_report
from tests.browser import Visit
from tests.finished import bulged_case, finished
from tests.viewer import FIXTURES, SAME, press

run, report, launch, browser, visit = FIXTURES


def zoomed(visit: Visit, act: Callable[[], None]) -> tuple[float, float]:
    """How far the page scrolls and how much the first picture changes when something is done."""
    before, was = visit.picture(0), visit.page.evaluate("scrollY")
    act()
    visit.page.wait_for_timeout(300)  # a browser scrolls smoothly
    visit.settle()
    return visit.page.evaluate("scrollY") - was, float(np.abs(visit.picture(0) - before).mean())


def test_the_wheel_scrolls_the_page_until_a_picture_is_clicked(visit: Visit) -> None:
    canvas = visit.page.locator("#panels canvas").first
    canvas.scroll_into_view_if_needed()
    canvas.hover()
    scrolled, changed = zoomed(visit, lambda: visit.page.mouse.wheel(0, 100))
    assert scrolled == 100
    assert changed < SAME
    assert visit.page.locator(".hint").inner_text() == "click to zoom with the wheel"
    visit.page.locator(".hint").wait_for(state="detached")
    canvas.scroll_into_view_if_needed()
    canvas.click()
    assert visit.page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    scrolled, changed = zoomed(visit, lambda: visit.page.mouse.wheel(0, 100))
    assert scrolled == 0
    assert changed > SAME
    visit.page.evaluate("document.activeElement.blur()")
    canvas.hover()
    scrolled, changed = zoomed(visit, lambda: visit.page.mouse.wheel(0, 100))
    assert (scrolled, visit.page.locator(".hint").count()) == (100, 0)  # it is said once
    assert changed < SAME


def fingers(visit: Visit, *paths: tuple[tuple[float, float], tuple[float, float]]) -> Callable[[], None]:
    """Fingers that go from one place to another, all at once."""
    session = visit.page.context.new_cdp_session(visit.page)

    def send(kind: str, share: float) -> None:
        at = [{"x": a[0] + share * (b[0] - a[0]), "y": a[1] + share * (b[1] - a[1])} for a, b in paths]
        points = [] if kind == "touchEnd" else [{**place, "id": k} for k, place in enumerate(at)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def move() -> None:
        send("touchStart", 0.0)
        for step in range(1, 9):
            send("touchMove", step / 8)
        send("touchEnd", 1.0)

    return move


def test_one_finger_scrolls_the_page_and_two_zoom_the_picture(browser: Any, report: Path) -> None:
    visit = Visit(browser, report, width=390, height=844, has_touch=True)
    canvas = visit.page.locator("#panels canvas").first
    canvas.evaluate("one => scrollBy(0, one.getBoundingClientRect().top - 300)")
    visit.settle()
    box = canvas.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    one = fingers(visit, ((x, y + 60), (x, y - 60)))
    two = fingers(visit, ((x - 20, y), (x - 90, y)), ((x + 20, y), (x + 90, y)))
    scrolled, changed = zoomed(visit, two)
    assert scrolled == 0
    assert changed > SAME
    scrolled, changed = zoomed(visit, one)
    assert scrolled > 50
    assert changed < SAME
    visit.page.evaluate("scrolled => scrollBy(0, -scrolled)", scrolled)
    visit.settle()
    visit.page.touchscreen.tap(x, y)  # gives it the focus, once the browser knows that it was no drag
    visit.page.wait_for_function("() => document.activeElement.style.touchAction === 'none'")
    visit.settle()  # the thread that scrolls hears of it with the next picture
    scrolled, changed = zoomed(visit, one)
    assert scrolled == 0
    assert changed > SAME
    visit.page.close()


def test_a_finger_means_a_point_within_a_target_of_24_pixels(browser: Any, report: Path) -> None:
    """Of places on a grid, more are taken for a point than with a mouse, which points more exactly."""
    visit = Visit(browser, report, width=390, height=844, has_touch=True)
    canvas = visit.page.locator("#panels canvas").first
    canvas.evaluate("one => scrollBy(0, one.getBoundingClientRect().top - 300)")
    visit.settle()
    box = canvas.bounding_box()
    share = np.linspace(0.3, 0.7, 6)
    places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x in share for y in share]
    counts = []
    for touch in (visit.page.touchscreen.tap, visit.page.mouse.click):
        said = []
        for x, y in places:
            touch(x, y)
            said.append(visit.page.locator("#readout").inner_text())
        counts.append(sum(" mm from " in one for one in said))
    assert counts[0] > 1.5 * counts[1]
    assert counts[1] > 0
    visit.page.close()


def test_fingers_find_controls_of_32_pixels(browser: Any, report: Path) -> None:
    visit = Visit(browser, report, width=390, height=844, has_touch=True, is_mobile=True)
    small = visit.page.evaluate("""() => [...document.querySelectorAll(
        '#viewer button, #viewer select, #viewer input[type=number], #viewer .handle')]
        .map((one) => [one.id || one.textContent, one.getBoundingClientRect()])
        .filter(([, box]) => box.width && Math.min(box.width, box.height) < 31.5).map(([name]) => name)""")
    assert small == []
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= 390
    visit.page.close()


def test_the_whole_screen_keeps_the_toolbar(visit: Visit) -> None:
    press(visit, "Full screen")
    visit.page.locator("#fullscreen[aria-pressed=true]").wait_for()
    assert visit.page.evaluate("document.fullscreenElement.id") == "viewer"
    visit.settle()
    for control in ("#field", "#fullscreen", "#surface-bar .auto"):
        box = visit.page.locator(control).bounding_box()
        assert 0 <= box["y"] <= box["y"] + box["height"] <= 900
    canvas = visit.page.locator("#panels canvas").first.bounding_box()
    assert canvas["height"] > 460  # the most that it has in the page
    visit.page.locator("#fullscreen").click()
    visit.page.locator("#fullscreen[aria-pressed=false]").wait_for()


def test_without_the_means_there_is_no_button_for_the_whole_screen(browser: Any, report: Path) -> None:
    context = browser.new_context()
    context.add_init_script("Object.defineProperty(Document.prototype, 'fullscreenEnabled', {value: false})")
    page = context.new_page()
    page.goto(report.resolve().as_uri())
    page.wait_for_function("() => document.documentElement.dataset.ready !== undefined", timeout=60_000)
    assert not page.locator("#fullscreen").is_visible()
    context.close()


def painted(visit: Visit) -> Any:
    """The first picture where its paint covers what is behind it: names stand on a transparent ground."""
    found = visit.picture(0).astype(float)
    return found[..., :3] * found[..., 3:] / 255


def on_white(picture: Any) -> Any:
    """The picture as on white paper."""
    return picture[..., :3] * picture[..., 3:] / 255 + 255 - picture[..., 3:]


def label_strengths(visit: Visit, *, names: bool = False) -> tuple[float, float]:
    """How much the marks on the wall, or the names beside it, change the left and the right half of the first
    picture.
    """
    visit.settle()
    visit.page.evaluate(
        "() => new Promise((done) => setTimeout(done, 300))"
    )  # the page looks after 150 ms of rest
    visit.settle()
    with_labels = painted(visit)
    visit.page.get_by_label("landmarks", exact=True).click()
    visit.settle()
    change = np.abs(with_labels - painted(visit)).max(axis=2)
    wall = np.flatnonzero((visit.picture(0)[:-110, :, 3] > 250).any(axis=0))
    edge = np.ptp(wall) // 5
    on_wall = slice(wall.min() + edge, wall.max() - edge)  # no name reaches so far
    change[:, on_wall] = np.where(names, 0.0, change[:, on_wall])
    if not names:
        change[:, : on_wall.start] = change[:, on_wall.stop :] = 0.0
    visit.page.get_by_label("landmarks", exact=True).click()
    visit.settle()
    middle = change.shape[1] // 2
    return float(change[:, :middle].max()), float(change[:, middle:].max())


def test_marks_behind_the_wall_are_faint_and_their_names_are_read(browser: Any, tmp_path: Path) -> None:
    """In AP one is behind on the right, two are in front on the left.

    A cut takes the wall before it away and has a section instead, which a translucent wall has not.
    """
    case = bulged_case()
    xyz = case.points.xyz.copy()
    xyz[case.points.type == "landmark"] = [[10, 17, 0], [-10, -15, -9], [-10, -17, 0]]
    folder = finished(tmp_path / "run", replace(case, points=replace(case.points, xyz=xyz)))
    visit = Visit(browser, write_report([folder]))
    visit.page.select_option("#field", label="no colour")
    in_front, behind = label_strengths(visit)
    assert in_front > 100
    assert 0.15 * in_front < behind < 0.6 * in_front  # 35 % of the ink
    in_front, behind = label_strengths(visit, names=True)
    assert in_front > 100
    assert 0.7 * in_front < behind < 0.95 * in_front
    press(visit, "PA")  # what was right is left, what was behind is in front
    in_front, behind = label_strengths(visit)
    assert 0.15 * in_front < behind < 0.6 * in_front
    press(visit, "AP")
    visit.page.select_option("#cut", label="coronal (y)")
    capped = label_strengths(visit)
    assert capped[1] < 0.6 * capped[0]
    visit.page.locator("#translucent").fill("0.05")
    left, right = label_strengths(visit)
    assert min(left, right) > 100
    visit.page.close()


def test_names_stand_apart_beside_the_surface_with_a_line_to_their_places(
    browser: Any, tmp_path: Path
) -> None:
    """Three landmarks in one place on the right of the picture, whose names would lie on each other."""
    case = bulged_case()
    xyz = case.points.xyz.copy()
    xyz[case.points.type == "landmark"] = [[10, -16, 0], [10, -16, 0.5], [10.5, -16, 0]]
    folder = finished(tmp_path / "run", replace(case, points=replace(case.points, xyz=xyz)))
    visit = Visit(browser, write_report([folder]))
    for box in visit.page.locator("#kinds input").all():
        box.uncheck()
    visit.page.select_option("#field", label="no colour")
    visit.settle()
    with_names = visit.picture(0)
    visit.page.uncheck("#labels")
    visit.settle()
    without = visit.picture(0)
    changed = np.abs(on_white(with_names) - on_white(without)).max(axis=2) > 60
    edge = int(np.flatnonzero((without[:-110, :, 3] > 250).any(axis=0)).max())  # of the ball
    rows = changed[:, edge + 14 :].any(axis=1)
    assert int((np.diff(rows.astype(int)) == 1).sum()) == 3  # names, with room between them
    on_ball = changed[:, : edge - 30]
    assert on_ball.any(axis=0).sum() > 20  # lines
    assert on_ball.sum(axis=0).max() < 40  # and no name
    visit.page.close()


def test_regions_not_to_rely_on_have_names_and_lines_that_are_faint_behind_the_wall(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One in front at the place of a landmark, whose name it leaves free, and one behind on the left."""
    case = bulged_case()
    xyz = case.points.xyz.copy()
    xyz[case.points.type == "landmark"] = [10, -16, 0]
    folder = finished(tmp_path / "run", replace(case, points=replace(case.points, xyz=xyz)))
    places = ("roof", [10.0, -16.0, 0.0]), ("ostium RIPV", [-9.0, 17.0, 0.0])
    doubts = [Doubt(name, "far", np.array(at)) for name, at in places]
    monkeypatch.setattr("o3dls.report.sections.order.doubted_regions", lambda *_: doubts)
    visit = Visit(browser, write_report([folder]))
    for box in visit.page.locator("#kinds input").all():
        box.uncheck()
    visit.page.select_option("#field", label="no colour")
    visit.page.wait_for_timeout(400)  # the page looks after 150 ms of rest what is behind the wall
    both = visit.picture(0)
    visit.page.uncheck("#doubts input")
    visit.settle()
    with_landmarks = visit.picture(0)
    visit.page.uncheck("#labels")
    visit.settle()
    without = visit.picture(0)
    red = red_ink(both) & ~red_ink(with_landmarks)
    middle = red.shape[1] // 2
    assert red[:, middle:].sum() > 100
    assert red[:, :middle].sum() > 100  # the name behind the wall is read, too
    wall = np.flatnonzero((without[:-110, :, 3] > 250).any(axis=0))
    inner = slice(wall.min() + np.ptp(wall) // 5, wall.max() - np.ptp(wall) // 5)
    assert not red[:, inner][:, : middle - inner.start].any()  # its line is too faint to be red
    assert red[:, inner][:, middle - inner.start :].any()
    assert (np.abs(both - with_landmarks)[:, :middle] > 10).any()
    marked = np.abs(with_landmarks - without)[..., :3].max(axis=2) > 60
    ball = int(np.flatnonzero((without[:-110, :, 3] > 250).any(axis=0)).max()) + 20
    assert not (red & marked)[:, ball:].any()  # no name lies on another
    visit.page.wait_for_function("() => location.hash.includes('hide=do')")  # a link to it has it so
    visit.page.close()


def red_ink(picture: Any) -> Any:
    """Where the colour of what is bad covers what is behind it."""
    return (picture[..., 3] > 200) & (picture[..., 0] > 120) & (picture[..., 1:3].max(axis=2) < 110)
