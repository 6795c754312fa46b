"""The orientation cube in a corner of each picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.report.writer import write_report
from tests.browser import Visit
from tests.finished import bulged_case, finished
from tests.viewer import FIXTURES

run, report, launch, browser, visit = FIXTURES

VIEWS = {"L": "LL", "R": "RL", "A": "AP", "P": "PA", "S": "superior", "I": "inferior"}


def view_name(visit: Visit) -> str:
    return str(visit.page.locator("#view-name").inner_text())


def seen_faces(visit: Visit, panel: int = 0) -> list[str]:
    """Letters of the faces that can be pressed."""
    faces = visit.page.locator("svg.cube").nth(panel).locator("path").all()
    return [one.get_attribute("aria-label").split(":")[0] for one in faces if one.is_visible()]


def press_face(visit: Visit, letter: str, panel: int = 0) -> None:
    visit.page.locator("svg.cube").nth(panel).get_by_label(f"{letter}: view").click()
    visit.settle()


def test_a_click_on_a_face_turns_all_pictures_to_its_view(visit: Visit) -> None:
    assert view_name(visit) == "AP"
    assert sorted(seen_faces(visit)) == ["A", "I", "L", "R", "S"]
    for letter, panel in (("L", 0), ("P", 1), ("R", 0), ("S", 1), ("P", 0), ("I", 0)):
        press_face(visit, letter, panel)
        assert view_name(visit) == VIEWS[letter]
        for one in (0, 1):
            assert set(VIEWS) - set(seen_faces(visit, one)) == {opposite(letter)}


def opposite(letter: str) -> str:
    return dict(zip("LRAPSI", "RLPAIS", strict=True))[letter]


def test_arrow_keys_and_enter_turn_the_cube(visit: Visit) -> None:
    """One face can be reached by Tab; seen from the front the patient's left is on the right."""
    cube = visit.page.locator("svg.cube").first
    assert cube.locator("[tabindex='0']").count() == 1
    cube.locator("[tabindex='0']").focus()
    for key, wanted in (("ArrowRight", "LL"), ("ArrowRight", "PA"), ("ArrowUp", "superior")):
        visit.page.keyboard.press(key)
        visit.settle()
        assert view_name(visit) == wanted
        assert visit.page.evaluate("document.activeElement.getAttribute('tabindex')") == "0"
    visit.page.locator("#panels canvas").first.press("ArrowLeft")
    visit.settle()
    assert view_name(visit) == "turned freely"
    cube.locator("[tabindex='0']").press("Enter")
    visit.settle()
    assert view_name(visit) == "superior"


def corner(picture: Any) -> Any:
    return picture[-62:, :62]


def test_the_cube_is_part_of_the_picture_and_turns_with_it(visit: Visit) -> None:
    """So that it is in saved pictures and on paper too."""
    before = corner(visit.picture(1))
    assert (before[..., 3] > 250).sum() > 20 * 20
    press_face(visit, "L")
    assert (np.abs(corner(visit.picture(1)) - before).max(axis=2) > 100).sum() > 20


def test_where_the_patients_axes_are_not_known_faces_are_numbered_sides(tmp_path: Path, browser: Any) -> None:
    case = bulged_case()
    mapped = case.points.of("eam", "ablation")
    unnamed = replace(case, points=mapped, frame="unknown", prior_frame="unknown")
    visit = Visit(browser, write_report([finished(tmp_path / "run", unnamed)]))
    assert sorted(seen_faces(visit)) == sorted("13456")
    press_face(visit, "4")
    assert view_name(visit) == "side 4"
    assert visit.errors == []
    visit.page.close()


@pytest.mark.parametrize("width", [1440, 390])
def test_a_face_is_large_enough_for_a_finger(launch: Callable[..., Any], report: Path, width: int) -> None:
    """24 pixels are what WCAG 2.5.8 asks of the face that looks at us."""
    visit = Visit(launch(), report, width=width)
    box = visit.page.locator("svg.cube path[tabindex='0']").first.bounding_box()
    assert min(box["width"], box["height"]) >= 24
    visit.page.close()
