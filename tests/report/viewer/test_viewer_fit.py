"""The fit as a slider: from estimate to estimate the wall of the last picture moves in straight lines."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.io.surfaces import read_surface, write_surface
from o3dls.report.drawing.estimates import MOST
from o3dls.report.drawing.scene import scene
from o3dls.report.subject import read_subject
from o3dls.report.writer import write_report
from tests.browser import Visit, violations
from tests.finished import bulged_case, fine_sphere, finished
from tests.viewer import FIXTURES, SAME, press

run, report, launch, browser, visit = FIXTURES


def slide(visit: Visit, at: float) -> None:
    visit.page.locator("#fit").fill(str(at))
    visit.settle()


def wall(visit: Visit) -> Any:
    """The last picture without marks."""
    for box in [*visit.page.locator("#kinds input").all(), visit.page.locator("#labels")]:
        box.uncheck()
    visit.settle()
    return visit.picture(1)


def right_edge(visit: Visit) -> int:
    """The last column that the wall of the last picture reaches, where the ball bulges."""
    there = wall(visit)[..., 3] > 250
    rows = len(there) // 5
    return int(np.flatnonzero(there[2 * rows : 3 * rows].any(axis=0)).max())


def stands(visit: Visit) -> str:
    return str(visit.page.locator("#fit").get_attribute("aria-valuetext"))


def test_the_slider_stops_at_every_estimate(visit: Visit) -> None:
    """It begins where the page does, at the result; a stop is the estimate as it is, with its colours."""
    assert stands(visit) == "level_set"
    result, other = wall(visit), visit.picture(0)
    for at, name in enumerate(("start", "icp", "level_set")):
        slide(visit, at)
        assert stands(visit) == name
        assert visit.page.locator("select.estimate").last.locator(":checked").inner_text() == name
        if name == "icp":
            assert np.abs(visit.picture(1) - other).mean() < SAME
    assert np.abs(visit.picture(1) - result).mean() < SAME
    visit.page.locator("select.estimate").last.select_option(label="start")
    assert stands(visit) == "start"
    press(visit, "level_set")
    assert visit.page.locator("#fit").input_value() == "2"


def test_between_stops_the_wall_moves_in_straight_lines(visit: Visit) -> None:
    press(visit, "AP")
    edges = []
    for at in (1, 1.5, 2):
        slide(visit, at)
        edges.append(right_edge(visit))
    before, middle, after = edges
    assert after - before > 8  # a bulge of 3 mm
    assert middle == pytest.approx((before + after) / 2, abs=1.5)
    slide(visit, 1.5)
    assert stands(visit) == "50 % of the way from icp to level_set"
    assert visit.page.locator("#panels figcaption small").last.inner_text() == stands(visit)
    assert visit.page.locator("#panels figcaption small").first.inner_text() == ""


def test_between_stops_colours_are_between_too(visit: Visit) -> None:
    """Of the distance to the truth: that of the result is zero."""
    slide(visit, 1)
    before = wall(visit)
    slide(visit, 1.5)
    middle = visit.picture(1)
    slide(visit, 2)
    after = visit.picture(1)
    there = (np.stack([before, middle, after])[..., 3] == 255).all(axis=0)
    lightness = [float(one[there][:, :3].mean()) for one in (before, middle, after)]
    assert lightness[0] + 2 < lightness[1] < lightness[2] - 2
    slide(visit, 1.5)
    visit.page.select_option("#field", label="posterior standard deviation")  # which the ICP has not
    visit.settle()
    grey = visit.picture(1)[there][:, :3]
    assert np.median(np.ptp(grey, axis=1)) < 8


def test_keys_move_it_and_nothing_moves_by_itself(visit: Visit) -> None:
    fit = visit.page.get_by_role("slider", name="Fit", exact=True)
    fit.focus()
    visit.page.keyboard.press("ArrowLeft")
    assert stands(visit) == "95 % of the way from icp to level_set"
    visit.page.wait_for_timeout(500)  # names that the wall hides are faint when a picture has come to rest
    once = visit.picture(1)
    visit.page.wait_for_timeout(500)
    assert (visit.picture(1) == once).all()
    visit.page.keyboard.press("Home")
    assert stands(visit) == "start"
    assert [text for text in violations(visit) if "fit" in text] == []


def test_a_place_between_is_in_the_address_and_in_before_and_after(visit: Visit, report: Path) -> None:
    slide(visit, 1.5)
    visit.page.wait_for_timeout(500)  # the page notes after 400 ms
    assert "fit=1.5" in visit.page.evaluate("location.hash")
    visit.page.reload()
    visit.page.wait_for_function("() => document.documentElement.dataset.ready !== undefined")
    assert stands(visit) == "50 % of the way from icp to level_set"
    press(visit, "Before / after")
    slide(visit, 1)
    assert visit.page.locator("#name-right").inner_text() == "icp"
    visit.requests[:] = visit.requests[:1]


def test_many_faces_are_fewer_on_the_way(tmp_path: Path) -> None:
    """They are those of the estimates that wait, so that they stand on the page once."""
    folder = finished(tmp_path / "run", replace(bulged_case(), prior=fine_sphere(36_000), truth=None))
    made = scene(read_subject([folder]))
    assert [stop["estimate"] for stop in made["fit"]["stops"]] == [0, 1, 2]
    assert made["fit"]["stops"][0]["positions"] == made["meshes"][0]["positions"]
    assert len(made["arrays"][made["fit"]["faces"]]) <= MOST * 3 * 2 * 4 / 3 + 4


def with_other_faces(folder: Path, *names: str) -> Path:
    """The run with the faces of estimates in another order."""
    for name in names:
        path = folder / "estimates" / name / "surface.ply"
        surface = read_surface(path)
        write_surface(path, replace(surface, faces=surface.faces[::-1].copy()))
    return folder


def test_estimates_of_other_faces_are_stops_without_a_way(browser: Any, run: Path, tmp_path: Path) -> None:
    """The slider goes from the one before to them at once. Where there is no way there is no slider."""
    folder = Path(shutil.copytree(run, tmp_path / "run"))
    visit = Visit(browser, write_report([with_other_faces(folder, "level_set")]))
    for at, name in ((1.4, "icp"), (1.6, "level_set"), (0.5, "50 % of the way from start to icp")):
        slide(visit, at)
        assert stands(visit) == name
    visit.page.close()
    visit = Visit(browser, write_report([with_other_faces(folder, "start", "icp")]))
    assert not visit.page.locator("#fit-tools").is_visible()
    assert visit.errors == []
    visit.page.close()
