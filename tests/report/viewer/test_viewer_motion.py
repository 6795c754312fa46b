"""The fit as a slider: the first picture moves from estimate to estimate, and only when it is asked to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.writer import write_report
from tests.browser import Visit
from tests.finished import Icp, LevelSet, bulged_case
from tests.tiny import sphere
from tests.viewer import FIXTURES, press

run, report, launch, browser, visit = FIXTURES


def move(visit: Visit, at: float) -> Any:
    visit.page.locator("#fit").fill(str(at))
    visit.settle()
    return visit.picture(0)


def without_marks(visit: Visit) -> None:
    for box in [*visit.page.locator("#kinds input").all(), visit.page.locator("#labels")]:
        box.uncheck()
    visit.page.uncheck("#hatched")
    visit.settle()


def right_edge(picture: Any) -> int:
    return int(np.flatnonzero((picture[:-70, :, 3] > 250).any(axis=0)).max())


def test_the_slider_stops_at_estimates_and_is_between_them_elsewhere(visit: Visit) -> None:
    """The level set bulges to the patient's left, by 3 mm; half of the way there it bulges by half."""
    without_marks(visit)
    visit.page.select_option("#field", label="no colour")
    names = visit.page.locator("#fit-stops option").all_text_contents()
    assert names == ["start", "icp", "level_set"]
    name, chosen = visit.page.locator("#fit-name"), visit.page.locator("select.estimate").first
    assert name.inner_text() == "icp"
    edges = []
    for at, said in ((1, "icp"), (1.5, "50 % from icp to level_set"), (2, "level_set")):
        edges.append(right_edge(move(visit, at)))
        assert name.inner_text() == said
    assert edges[2] > edges[0] + 8
    assert abs(edges[1] - (edges[0] + edges[2]) / 2) <= 2
    assert chosen.evaluate("one => one.selectedOptions[0].text") == "level_set"
    np.testing.assert_allclose(visit.picture(0)[:-70], visit.picture(1)[:-70], atol=40)
    chosen.select_option(label="start")
    assert name.inner_text() == "start"


def test_keys_move_the_slider_and_nothing_else_does(visit: Visit) -> None:
    without_marks(visit)  # names become faint when the pictures rest
    fit = visit.page.locator("#fit")
    fit.focus()
    for key, said in (
        ("Home", "start"),
        ("ArrowRight", "5 % from start to icp"),
        ("PageUp", "icp"),
        ("End", "level_set"),
        ("ArrowLeft", "95 % from icp to level_set"),
        ("PageDown", "icp"),
    ):
        visit.page.keyboard.press(key)
        visit.settle()
        assert fit.get_attribute("aria-valuetext") == said
    before = visit.picture(0)
    visit.page.wait_for_timeout(1000)
    np.testing.assert_allclose(visit.picture(0), before, atol=2)  # a pixel may be rounded otherwise


def test_colours_are_read_between_two_estimates(visit: Visit) -> None:
    """In the middle of the picture the value is that between the two."""
    without_marks(visit)
    visit.page.select_option("#field", label="distance to truth")
    box = visit.page.locator("#panels canvas").first.bounding_box()
    values = []
    for at in (1, 1.5, 2):
        move(visit, at)
        visit.page.mouse.move(box["x"] + box["width"] / 2 + at, box["y"] + box["height"] / 2)
        visit.settle()
        visit.settle()
        values.append(float(visit.page.locator("#readout").inner_text().split()[-2]))
    assert abs(values[1] - (values[0] + values[2]) / 2) < 0.1
    assert abs(values[0] - values[2]) > 0.1


def test_a_place_between_is_in_the_address_and_left_for_before_and_after(visit: Visit, browser: Any) -> None:
    move(visit, 1.25)
    visit.page.wait_for_function("() => location.hash.includes('fit=1.25')")
    other = Visit(browser, visit.page.url)
    other.settle()
    assert other.page.locator("#fit-name").inner_text() == "25 % from icp to level_set"
    other.page.close()
    press(visit, "Before / after")
    assert not visit.page.locator("#fit").is_visible()
    press(visit, "Before / after")
    assert visit.page.locator("#fit-name").inner_text() == "icp"


class Remesh(LevelSet):
    """The result on faces of its own, 4 mm larger, as after a change of topology."""

    name: ClassVar[str] = "remesh"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        found = super().__call__(case, start)
        own = sphere(rings=10)
        return replace(found, surface=own.with_vertices(1.2 * own.vertices), motion=None)


class Same(Icp):
    """A stage that changes nothing."""

    name: ClassVar[str] = "same"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        return start


def test_a_surface_of_its_own_faces_is_a_stop_and_the_last_is_the_result(
    browser: Any, tmp_path: Path
) -> None:
    run = Pipeline([Icp(), LevelSet(), Remesh(), Same()], folds=0).run(bulged_case()).write(tmp_path / "run")
    visit = Visit(browser, write_report([run]))
    without_marks(visit)
    visit.page.select_option("#field", label="no colour")
    assert visit.page.locator("#fit-stops option").all_text_contents() == [
        "start",
        "icp",
        "level_set",
        "same",
    ]
    edges = {}
    name, fit = visit.page.locator("#fit-name"), visit.page.locator("#fit")
    for at, said in ((1.4, "40 % from icp to level_set"), (2.4, "level_set"), (2.6, "same"), (3, "same")):
        edges[at] = right_edge(move(visit, at))
        assert name.inner_text() == said
        assert float(fit.input_value()) == (at if at == 1.4 else round(at))
    assert edges[2.6] == edges[3]
    assert edges[3] > edges[2.4] + 4
    fit.focus()
    for key, said in (("ArrowLeft", "level_set"), ("ArrowRight", "same"), ("PageDown", "level_set")):
        visit.page.keyboard.press(key)
        visit.settle()
        assert fit.get_attribute("aria-valuetext") == said
    assert right_edge(visit.picture(0)) == edges[2.4]
    visit.page.close()
