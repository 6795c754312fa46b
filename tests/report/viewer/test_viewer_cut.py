"""The cut: the view faces it, either side can be taken away, and the section is filled."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tests.browser import Visit
from tests.viewer import FIXTURES, press

run, report, launch, browser, visit = FIXTURES


def choose_cut(visit: Visit, name: str) -> None:
    visit.page.select_option("#cut", label=name)
    visit.settle()


def without_marks(visit: Visit) -> None:
    for box in [*visit.page.locator("#kinds input").all(), visit.page.locator("#labels")]:
        box.uncheck()
    visit.page.uncheck("#hatched")
    visit.settle()


def filled(picture: Any) -> Any:
    """Where a picture has the grey of the cap."""
    rgb = picture[..., :3]
    return (
        (np.ptp(rgb, axis=2) < 3)
        & (rgb.min(axis=2) > 160)
        & (rgb.max(axis=2) < 225)
        & (picture[..., 3] > 250)
    )


@pytest.mark.parametrize(
    ("cut", "faces", "other"),
    [("sagittal (x)", "LL", "RL"), ("coronal (y)", "AP", "PA"), ("axial (z)", "superior", "inferior")],
)
def test_the_view_faces_the_cut_from_either_side(visit: Visit, cut: str, faces: str, other: str) -> None:
    name = visit.page.locator("#view-name")
    press(visit, "LAO 45")
    choose_cut(visit, cut)
    assert name.inner_text() == faces
    press(visit, "Show the other side")
    assert name.inner_text() == other
    press(visit, "LAO 45")
    press(visit, "Show the other side")
    assert name.inner_text() == faces
    choose_cut(visit, "none")
    assert not visit.page.locator("#cut-flip").is_visible()


def test_the_section_of_a_cut_is_filled_and_nothing_beside_it(visit: Visit) -> None:
    """A ball of 20 mm, cut through its middle, and then through a place nearer its edge."""
    without_marks(visit)
    choose_cut(visit, "coronal (y)")
    tall = float(visit.page.locator("#panels").get_attribute("data-tall"))
    areas = []
    for level in ("0.5", "0.8"):
        visit.page.locator("#level").fill(level)
        visit.settle()
        picture = visit.picture(0)
        areas.append(filled(picture)[:-70].sum() * (tall / picture.shape[0]) ** 2)
    assert areas[0] == pytest.approx(np.pi * 20**2, rel=0.15)  # less half of the line around it
    assert 0.3 < areas[1] / areas[0] < 0.9
    press(visit, "PA")
    assert filled(visit.picture(0))[:-70].sum() < 500  # seen from behind, the wall hides it
    press(visit, "AP")
    visit.page.locator("#translucent").fill("0.05")
    visit.settle()
    assert filled(visit.picture(0))[:-70].mean() < 0.01  # one looks inside


def test_the_far_wall_is_not_read_through_the_section(visit: Visit) -> None:
    without_marks(visit)
    choose_cut(visit, "coronal (y)")
    box = visit.page.locator("#panels canvas").nth(1).bounding_box()
    seen = []
    for amount in ("0", "0.05"):
        visit.page.locator("#translucent").fill(amount)
        visit.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + float(amount))
        visit.settle()
        visit.settle()
        seen.append(visit.page.locator("#readout").inner_text())
        visit.page.mouse.move(5, 5)
    assert seen[0].startswith("Point at a surface")
    assert seen[1].startswith("level_set: ")


def test_the_side_of_a_cut_is_in_the_address(visit: Visit, browser: Any) -> None:
    choose_cut(visit, "sagittal (x)")
    press(visit, "Show the other side")
    press(visit, "RAO 30")
    visit.page.wait_for_function("() => /flipped/.test(location.hash) && /RAO/.test(location.hash)")
    other = Visit(browser, visit.page.url)
    other.settle()
    assert other.page.locator("#view-name").inner_text() == "RAO 30"
    assert other.page.evaluate("location.hash") == visit.page.evaluate("location.hash")
    assert np.abs(other.picture(1) - visit.picture(1)).mean() < 0.5
    other.page.close()


def test_the_line_of_the_cut_stands_out(visit: Visit) -> None:
    """Both it and its edge are seen on wall of any colour: the page's own colour is beside it."""
    without_marks(visit)
    choose_cut(visit, "coronal (y)")
    picture = visit.picture(1)
    row = picture[picture.shape[0] // 2 - 40, : picture.shape[1] // 2]
    cap = np.flatnonzero(filled(row[None])[0])[0]
    beside = row[cap - 9 : cap, :3]
    assert (beside.min(axis=1) > 240).any()
    assert (np.ptp(beside, axis=1) > 60).any()
    calls = json.loads(visit.page.evaluate("document.documentElement.dataset.drawCalls"))
    assert max(calls) <= 12
