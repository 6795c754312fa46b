"""The state of the view in the address of the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.browser import Visit
from tests.viewer import FIXTURES, SAME, press, type_range

run, report, launch, browser, visit = FIXTURES


def address(visit: Visit) -> str:
    """What stands behind the # when the page has noted the present state."""
    visit.settle()
    visit.page.evaluate("() => new Promise((done) => setTimeout(done, 500))")  # the page notes after 400 ms
    return str(visit.page.evaluate("location.hash"))


def set_all(visit: Visit) -> None:
    page = visit.page
    page.select_option("#field", label="distance to the nearest point")
    type_range(visit, "1", "12.5")
    type_range(visit, "0.25", "2", "#point-bar")
    page.locator("#translucent").fill("0.3")
    page.select_option("#ghost", label="prior")
    page.select_option("#cut", label="coronal (y)")
    page.locator("#level").fill("0.4")
    for label in ("ablation", "landmarks", "hatch: no points here, shape from the image"):
        page.get_by_label(label, exact=True).click()
    press(visit, "LAO 45")
    page.locator("#panels canvas").first.focus()
    page.keyboard.press("+")


def test_the_address_has_the_state_and_brings_it_back(browser: Any, visit: Visit, report: Path) -> None:
    assert address(visit) == ""
    set_all(visit)
    said = address(visit)
    assert said == (
        "#view=LAO+45&zoom=1.2&field=distance_to_nearest_point_mm&range=1,12.5&points=0.25,2&cut=y:0.4"
        "&ghost=prior&translucent=0.3&hide=ablation&labels=off&hatch=off"
    )
    again = opened(browser, report, said)
    for k in range(2):
        assert np.abs(again.picture(k) - visit.picture(k)).mean() < SAME
    assert address(again) == said
    again.page.close()


def opened(browser: Any, report: Path, hash_: str) -> Visit:
    """The page at an address with a state; without errors."""
    found = Visit(browser, Linked(report, hash_))  # type: ignore[arg-type]
    assert found.errors == []
    found.settle()
    return found


class Linked:
    """A path with something behind a #."""

    def __init__(self, path: Path, hash_: str) -> None:
        self.path, self.hash = path, hash_

    def resolve(self) -> Linked:
        return self

    def as_uri(self) -> str:
        return self.path.resolve().as_uri() + self.hash


def test_a_turned_camera_and_the_divider_are_in_the_address(browser: Any, visit: Visit, report: Path) -> None:
    press(visit, "Before / after")
    visit.page.select_option("#pair-left", label="icp")
    type_range(visit, "0", "1.5")
    visit.page.locator("#divider").focus()
    visit.page.keyboard.press("PageUp")
    visit.page.locator("#panels canvas").first.focus()
    visit.page.keyboard.press("ArrowLeft")
    visit.page.keyboard.press("ArrowDown")
    said = address(visit)
    assert "from=" in said
    assert "view=" not in said
    assert said.endswith("&range=0,1.5&before=icp&after=level_set&divider=60")
    again = opened(browser, report, said + "&target=0,5,0")
    assert again.page.locator("#divider").get_attribute("aria-valuetext") == "60 % icp, 40 % level_set"
    assert "target=0,5,0" in address(again)
    again.page.close()


def test_chosen_estimates_and_a_free_cut_are_in_the_address(browser: Any, visit: Visit, report: Path) -> None:
    """The cut keeps its direction when the camera has turned since."""
    visit.page.locator("select.estimate").first.select_option(label="start")
    press(visit, "RAO 30")
    visit.page.select_option("#cut", label="free")
    visit.page.locator("#level").fill("0.4")
    press(visit, "PA")
    visit.page.get_by_label("start", exact=True).uncheck()
    said = address(visit)
    view, cut, estimates, hidden = said.split("&")
    assert (view, estimates, hidden) == ("#view=PA", "estimates=start%7Clevel_set", "hide=start")
    assert cut.startswith("cut=free:0.4:")
    direction = [float(one) for one in cut.split(":")[-1].split(",")]
    assert direction == pytest.approx([-0.5, -(0.75**0.5), 0.0], abs=1e-3)  # RAO 30 of a case in LPS
    again = opened(browser, report, said)
    assert again.page.locator("#cut :checked").inner_text() == "free"
    assert np.abs(again.picture(1) - visit.picture(1)).mean() < SAME
    assert address(again) == said
    again.page.close()


@pytest.mark.parametrize(
    "cut", ["free:0.4", "free:0.4:0,0,0", "free:0.4:1,x,0", "free:7:1,0,0", "free::1,0,0"]
)
def test_a_free_cut_that_does_not_fit_is_ignored(browser: Any, report: Path, cut: str) -> None:
    page = opened(browser, report, f"#cut={cut}")
    assert page.page.locator("#cut").input_value() == ""
    assert page.page.locator("#level").is_disabled()
    page.page.close()


def test_a_wrong_or_old_address_is_ignored(browser: Any, report: Path, visit: Visit) -> None:
    wrong = (
        "#view=UP&from=1,x,0&zoom=-3&target=1,2&field=gone&range=5,1&points=,&isochrones=5&cut=q:2&cut=x:7"
        "&ghost=moon&translucent=2&hide=nothing&labels=maybe&before=nothing&divider=150&more=%E0%A4%A&&="
    )
    page = opened(browser, report, wrong)
    for k in range(2):
        assert np.abs(page.picture(k) - visit.picture(k)).mean() < SAME
    page.page.close()


def test_sections_keep_their_addresses(browser: Any, report: Path) -> None:
    page = opened(browser, report, "#scores")
    assert address(page) == "#scores"
    assert abs(page.page.locator("#scores").bounding_box()["y"]) < 120
    press(page, "PA")
    assert address(page) == "#view=PA"
    page.page.locator("nav a[href='#scores']").click()
    assert address(page) == "#scores"
    page.page.close()


@pytest.mark.parametrize(("closed", "said"), [("false", "Copied"), ("true", "It is in the address bar")])
def test_the_link_is_copied(visit: Visit, report: Path, closed: str, said: str) -> None:
    visit.page.evaluate(
        f"""() => Object.defineProperty(navigator, 'clipboard', {{ value: {{
            writeText: async (text) => {{ if ({closed}) throw new Error('closed'); window.copied = text; }}
        }} }})"""
    )
    press(visit, "PA")
    press(visit, "Copy link")
    assert visit.page.locator("#link").inner_text() == said
    copied = visit.page.evaluate("window.copied ?? location.href")
    assert copied == report.resolve().as_uri() + "#view=PA"
    press(visit, "AP")
    assert address(visit) == ""
    assert visit.page.locator("#link").inner_text() == "Copy link"
