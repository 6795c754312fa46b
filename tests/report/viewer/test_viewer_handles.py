"""Handles at the ends of the colour bars: dragged, or moved by keys."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.report.drawing.colour_maps import colour_table
from tests.browser import Visit
from tests.viewer import FIXTURES, SAME, type_range

run, report, launch, browser, visit = FIXTURES


def handle(visit: Visit, end: str, bar: str = "#surface-bar") -> Any:
    return visit.page.locator(f"{bar} .{end}-handle")


def ends(visit: Visit, bar: str = "#surface-bar") -> tuple[float, float]:
    """The numbers that are written beside a bar."""
    low, high = (float(visit.page.locator(f"{bar} .{end}").input_value()) for end in ("low", "high"))
    return low, high


def middle(found: Any) -> tuple[float, float]:
    box = found.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def hold(visit: Visit, end: str, share: float, bar: str = "#surface-bar") -> None:
    """Drag a handle to a share of its bar, and hold it there."""
    scale = visit.page.locator(f"{bar} canvas")
    scale.scroll_into_view_if_needed()
    box = scale.bounding_box()
    visit.page.mouse.move(*middle(handle(visit, end, bar)))
    visit.page.mouse.down()
    visit.page.mouse.move(box["x"] + share * box["width"], box["y"] + 5, steps=4)
    visit.settle()


def bar_colours(visit: Visit) -> Any:
    """Colours (256, 3) of the bar of the surface."""
    return np.array(
        visit.page.evaluate(
            """() => [...document.querySelector('#surface-bar canvas').getContext('2d')
                .getImageData(0, 0, 256, 1).data]"""
        )
    ).reshape(256, 4)[:, :3]


def test_a_dragged_handle_moves_an_end_of_the_colours(visit: Visit) -> None:
    """While it is held the numbers of the bar stay; colours lie between the handles, then along all of it."""
    type_range(visit, "0", "4")
    before, ticks = visit.picture(0), visit.page.locator("#surface-bar .ticks").inner_text()
    whole = np.round(255 * colour_table("sequential"))
    np.testing.assert_allclose(bar_colours(visit), whole, atol=1)
    hold(visit, "high", 0.5)
    assert ends(visit) == pytest.approx((0, 2), abs=0.05)
    assert visit.page.locator("#surface-bar .ticks").inner_text() == ticks
    np.testing.assert_allclose(bar_colours(visit)[140:], whole[-1:].repeat(116, axis=0), atol=1)
    assert np.abs(visit.picture(0) - before).mean() > 1
    visit.page.mouse.up()
    visit.settle()
    np.testing.assert_allclose(bar_colours(visit), whole, atol=1)
    box = visit.page.locator("#surface-bar canvas").bounding_box()
    assert middle(handle(visit, "high"))[0] == pytest.approx(box["x"] + box["width"], abs=2)
    dragged = visit.picture(0)
    type_range(visit, *map(str, ends(visit)))
    assert np.abs(visit.picture(0) - dragged).mean() < SAME  # it does what typing does


def test_a_handle_goes_beyond_the_bar_and_not_past_the_other(visit: Visit) -> None:
    type_range(visit, "1", "3", "#point-bar")
    hold(visit, "low", -0.25, "#point-bar")
    visit.page.mouse.up()
    assert ends(visit, "#point-bar") == pytest.approx((0.5, 3), abs=0.05)
    hold(visit, "low", 1.5, "#point-bar")
    visit.page.mouse.up()
    low, high = ends(visit, "#point-bar")
    assert 0 < high - low < 0.05
    assert "wrong" not in visit.page.locator("#point-bar").get_attribute("class")
    visit.page.locator("#point-bar .auto").click()
    assert ends(visit, "#point-bar")[0] == 0


def test_keys_move_a_handle_which_says_where_it_is(visit: Visit) -> None:
    type_range(visit, "0", "4")
    high = visit.page.get_by_role("slider", name="Upper handle of the surface's colours")
    assert high.get_attribute("aria-valuenow") == "4"
    high.focus()
    visit.page.keyboard.press("ArrowLeft")
    one = 4 - ends(visit)[1]
    assert 0 < one < 0.5
    for _ in range(3):
        visit.page.keyboard.press("PageDown")
    assert ends(visit)[1] == pytest.approx(max(4 - 31 * one, one))
    visit.page.keyboard.press("PageUp")
    assert float(high.get_attribute("aria-valuenow")) == pytest.approx(ends(visit)[1])
    assert high.evaluate("one => one === document.activeElement")


def test_ends_of_signed_values_move_together(visit: Visit) -> None:
    visit.page.select_option("#field", label="displacement, outward positive")
    hold(visit, "low", 0.25)
    visit.page.mouse.up()
    low, high = ends(visit)
    assert low == -high < 0
    hold(visit, "low", 0.9)  # beyond the middle
    visit.page.mouse.up()
    low, high = ends(visit)
    assert low == -high < 0


@pytest.mark.parametrize("width", [1440, 390])
def test_a_handle_is_large_enough_for_a_finger_and_hides_no_mark(
    launch: Callable[..., Any], report: Path, width: int
) -> None:
    """24 pixels are what WCAG 2.5.8 asks; the triangle at the end says that there are values beyond it."""
    visit = Visit(launch(), report, width=width)
    box = handle(visit, "high").bounding_box()
    assert min(box["width"], box["height"]) >= 24
    mark = visit.page.locator("#surface-bar .over")
    assert mark.is_visible()
    assert mark.bounding_box()["x"] + 2 > box["x"] + box["width"] - 2
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= width
    visit.page.close()
