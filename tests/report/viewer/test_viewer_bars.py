"""Colour bars: round numbers, and marks where values lie beyond an end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.browser import Visit
from tests.viewer import FIXTURES, press, type_range

run, report, launch, browser, visit = FIXTURES


def bar_says(visit: Visit, bar: str = "#surface-bar") -> tuple[list[float], bool, bool]:
    """Numbers under a bar, and whether it marks values below and above its ends."""
    found = visit.page.locator(bar)
    numbers = [float(text.strip("≤≥ ")) for text in found.locator(".ticks span").all_inner_texts()]
    return numbers, found.locator(".under").is_visible(), found.locator(".over").is_visible()


@pytest.mark.parametrize(
    ("low", "high", "wanted"),
    [
        ("0", "30", [0, 10, 20, 30]),
        ("1.9", "12.1", [2.5, 5, 7.5, 10]),
        ("-180", "14", [-150, -100, -50, 0]),
        ("0", "5", [0, 1, 2, 3, 4, 5]),
        ("-10", "10", [-10, -5, 0, 5, 10]),
        ("0.5", "1.5", [0.5, 0.75, 1, 1.25, 1.5]),
        ("0.00001", "0.00003", [1e-5, 1.5e-5, 2e-5, 2.5e-5, 3e-5]),
    ],
)
def test_colour_bars_have_round_numbers_at_their_places(
    visit: Visit, low: str, high: str, wanted: list[float]
) -> None:
    type_range(visit, low, high)
    assert bar_says(visit)[0] == wanted
    places = visit.page.evaluate(
        """() => {
            const bar = document.querySelector('#surface-bar canvas').getBoundingClientRect();
            return [...document.querySelectorAll('#surface-bar .ticks span')].map((one) => {
                const box = one.getBoundingClientRect();
                return (box.left + box.width / 2 - bar.left) / bar.width;
            });
        }"""
    )
    shares = (np.array(wanted) - float(low)) / (float(high) - float(low))
    np.testing.assert_allclose(places, shares, atol=0.01)  # of the bar's width: a pixel or two


def test_colour_bars_mark_values_beyond_their_ends(visit: Visit) -> None:
    """Only where the shown estimates have such values: the start is farther off than those shown at first."""
    type_range(visit, "0", "0.5")
    assert bar_says(visit)[1:] == (False, True)
    assert visit.page.locator("#surface-bar .ticks span").last.inner_text() == "≥ 0.5"
    title = visit.page.locator("#surface-bar .over").get_attribute("title")
    assert title == "values beyond are shown in the end's colour"
    type_range(visit, "-1", "1000")
    assert bar_says(visit)[1:] == (False, False)
    type_range(visit, "0.5", "1000")
    assert bar_says(visit)[1:] == (True, False)
    type_range(visit, "0", "1000", "#point-bar")
    assert bar_says(visit, "#point-bar")[1:] == (False, False)
    type_range(visit, "3", "4", "#point-bar")
    assert bar_says(visit, "#point-bar")[1:] == (True, True)
    visit.page.select_option("#field", label="posterior standard deviation")  # which the ICP has not
    highest = visit.page.locator("#surface-bar .high").input_value()
    visit.page.get_by_label("level_set", exact=True).click()
    type_range(visit, "0", str(float(highest) / 2))
    assert bar_says(visit)[1:] == (False, False)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_ticks_stand_out(browser: Any, report: Path, scheme: str) -> None:
    """3:1 is what WCAG 1.4.11 asks of graphics."""
    visit = Visit(browser, report, color_scheme=scheme)
    line, page = visit.page.evaluate(
        """() => [
            getComputedStyle(document.querySelector('.ticks span'), '::before').borderLeftColor,
            getComputedStyle(document.body).backgroundColor,
        ].map((colour) => colour.match(/[\\d.]+/g).slice(0, 3).map(Number))"""
    )
    shares = np.array([line, page]) / 255
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    low, high = sorted(linear @ [0.2126, 0.7152, 0.0722])
    assert (high + 0.05) / (low + 0.05) >= 3
    visit.page.close()


def test_a_saved_picture_has_the_numbers_and_marks(visit: Visit, tmp_path: Path) -> None:
    from matplotlib.image import imread

    type_range(visit, "0", "1")
    pictures = []
    for k, marked in enumerate((True, False)):
        if not marked:
            visit.page.evaluate("document.querySelector('#surface-bar .over').hidden = true")
        with visit.page.expect_download() as waiting:
            press(visit, "Save picture")
        waiting.value.save_as(tmp_path / f"{k}.png")
        pictures.append(imread(tmp_path / f"{k}.png"))
    rows, columns = np.nonzero(np.abs(pictures[0] - pictures[1]).max(axis=2) > 0.1)
    assert 30 < len(rows) < 400  # a triangle, and nothing else
    assert max(np.ptp(rows), np.ptp(columns)) < 40
    assert pictures[0][rows.max() :, :, :3].std() > 0.02  # numbers and name below it


def ends(visit: Visit) -> list[float]:
    return [float(visit.page.locator(f"#surface-bar {end}").input_value()) for end in (".low", ".high")]


def test_the_ends_of_the_colours_are_dragged(visit: Visit) -> None:
    """A fifth of the bar is a fifth of its range, also beyond its end; the two do not pass each other."""
    type_range(visit, "0", "1")
    before = visit.picture(0)
    bar = visit.page.locator("#surface-bar canvas").bounding_box()
    y, at = bar["y"] + bar["height"] / 2, lambda share: bar["x"] + share * bar["width"]

    def drag(start: float, to: float) -> None:
        visit.page.mouse.move(at(start), y)
        visit.page.mouse.down()
        visit.page.mouse.move(at((start + to) / 2), y)
        visit.page.mouse.move(at(to), y)
        visit.page.mouse.up()
        visit.settle()

    for start, to, wanted in (
        (0, 0.2, (0.2, 1)),
        (1, 1.25, (0.2, 1.2)),
        (0, 2, (1.19, 1.2)),
        (1, 0.5, (1.19, 1.195)),
    ):
        drag(start, to)
        np.testing.assert_allclose(ends(visit), wanted, atol=0.015)
    assert np.abs(visit.picture(0) - before).mean() > 1
    first = visit.page.locator("#surface-bar .handle").first.bounding_box()
    assert first["x"] + first["width"] / 2 == pytest.approx(at(0), abs=2)  # it is at the end again


def test_the_ends_of_the_colours_follow_keys(visit: Visit) -> None:
    type_range(visit, "0", "10")
    handle = visit.page.get_by_role("slider", name="Upper threshold of the surface's colours")
    press_at = visit.page.keyboard.press
    automatic = visit.page.evaluate(
        "() => JSON.parse(document.getElementById('scene').textContent).fields[0].range[1]"
    )
    handle.focus()
    press_at("ArrowRight")
    assert ends(visit)[1] == pytest.approx(10 + automatic / 100, abs=0.06)
    assert float(handle.get_attribute("aria-valuenow")) == ends(visit)[1]
    press_at("PageDown")
    assert ends(visit)[1] < 10
    press_at("Home")
    assert ends(visit)[1] == pytest.approx(automatic, rel=0.01)
    visit.page.select_option("#field", label="displacement, outward positive")
    visit.page.get_by_role("slider", name="Lower threshold of the surface's colours").press("PageUp")
    low, high = ends(visit)
    assert low == -high  # zero keeps the middle of the colours


def test_a_handle_of_signed_values_does_not_pass_zero(visit: Visit) -> None:
    """The ends mirror each other: a low end above zero would be no range."""
    visit.page.select_option("#field", label="displacement, outward positive")
    handle, scale = visit.page.locator("#surface-bar .at-low"), visit.page.locator("#surface-bar canvas")
    handle.scroll_into_view_if_needed()
    held, bar = handle.bounding_box(), scale.bounding_box()
    visit.page.mouse.move(held["x"] + held["width"] / 2, held["y"] + held["height"] / 2)
    visit.page.mouse.down()
    visit.page.mouse.move(bar["x"] + 0.8 * bar["width"], held["y"] + 8, steps=3)
    visit.page.mouse.up()
    low, high = (float(visit.page.locator(f"#surface-bar .{end}").input_value()) for end in ("low", "high"))
    assert low == -high < 0
    assert "wrong" not in visit.page.locator("#surface-bar").get_attribute("class")
