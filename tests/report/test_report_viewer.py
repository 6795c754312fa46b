"""What one can ask of the pictures: any estimate in any panel, what lies under the pointer, the worst points,
a distance, a free cut.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from o3dls.case import Case
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.surface import interpolated
from o3dls.pipeline.pipeline import Pipeline
from o3dls.report.drawing.packing import coded, once, packed
from o3dls.report.drawing.scene import scene
from o3dls.report.subject import read_subject
from o3dls.report.writer import write_report
from tests.browser import Visit, chromium
from tests.finished import Icp, LevelSet, bulged_case, fine_sphere, finished

MOST_CALLS = 12
PIXEL = 0.17  # mm that a pixel of a panel spans, at most: how exactly a place can be hit
BLENDED = 1  # of 255: what a canvas rounds where it blends edges


def named_points() -> Case:
    case = bulged_case()
    ids = np.arange(len(case.points)) + 700.0
    return replace(case, points=replace(case.points, columns={**case.points.columns, "id": ids}))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("viewer") / "run", named_points())


@pytest.fixture(scope="module")
def report(run: Path) -> Path:
    return write_report([run])


@pytest.fixture(scope="module")
def browser() -> Iterator[Callable[..., Any]]:
    with chromium() as launch:
        yield launch()


@pytest.fixture
def visit(browser: Any, report: Path) -> Iterator[Visit]:
    opened = Visit(browser, report, width=800, height=700)  # small pictures are quick
    opened.page.get_by_text("More controls", exact=True).click()  # folded where the window is narrow
    opened.page.locator("#panels canvas").first.scroll_into_view_if_needed()
    yield opened
    assert [text for text in opened.errors if "willReadFrequently" not in text] == []  # said of our looking
    opened.page.close()


def place(visit: Visit, panel: int, right: float = 0.0, up: float = 0.0) -> tuple[float, float]:
    """Where a panel shows what is so many mm beside its middle."""
    canvas = visit.page.locator("#panels canvas").nth(panel)
    canvas.scroll_into_view_if_needed()  # a press of a button may have moved it out of the window
    box = canvas.bounding_box()
    per_mm = box["height"] / float(visit.page.locator("#panels").get_attribute("data-tall"))
    return box["x"] + box["width"] / 2 + right * per_mm, box["y"] + box["height"] / 2 - up * per_mm


def click(visit: Visit, panel: int, right: float = 0.0, up: float = 0.0) -> None:
    visit.page.mouse.click(*place(visit, panel, right, up))
    visit.settle()


def line(visit: Visit) -> str:
    visit.settle()
    return str(visit.page.locator("#readout").inner_text())


def without_points(visit: Visit) -> None:
    for box in visit.page.locator("#kinds input").all():
        box.uncheck()
    visit.settle()


def without_names(visit: Visit) -> None:
    """Names behind the wall become faint some time after a picture is drawn: no part of what is compared."""
    visit.page.uncheck("#labels")
    visit.settle()


def same_picture(one: Any, other: Any) -> None:
    np.testing.assert_allclose(one, other, atol=BLENDED)


def choose(visit: Visit, panel: int, name: str) -> None:
    visit.page.locator("select.estimate").nth(panel).select_option(label=name)
    visit.settle()


KEEP = """() => {
    const ask = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
        const made = ask.call(this, kind, ...rest);
        if (kind === 'webgl2') window.drawing = this;
        return made;
    };
}"""


def test_the_drawing_buffer_is_kept(browser: Any, report: Path) -> None:
    """Some drivers copy later than asked, which drawing by software does not show: what was asked counts."""
    page = browser.new_page()
    page.add_init_script(f"({KEEP})()")
    page.goto(report.resolve().as_uri())
    page.wait_for_function("() => document.documentElement.dataset.ready !== undefined")
    assert page.evaluate("drawing.getContext('webgl2').getContextAttributes().preserveDrawingBuffer")
    page.close()


def test_any_estimate_can_be_shown_in_any_panel(visit: Visit) -> None:
    selects = visit.page.locator("select.estimate")
    assert selects.first.locator("option").all_inner_texts() == ["start", "icp", "level_set"]
    assert [selects.nth(k).input_value() for k in (0, 1)] == ["1", "2"]
    without_names(visit)
    before, other = visit.picture(0), visit.picture(1)
    choose(visit, 0, "level_set")
    same_picture(visit.picture(0), other)  # surface, colours, points and outliers
    assert np.abs(visit.picture(0) - before).mean() > 1
    assert visit.page.locator("#shown").inner_text().split() == ["level_set", "level_set"]
    choose(visit, 0, "icp")
    same_picture(visit.picture(0), before)


def test_contours_legend_and_ghost_follow_the_estimate(visit: Visit) -> None:
    visit.page.select_option("#cut", label="axial (z)")
    legend = visit.page.locator("#legend span")
    assert legend.all_inner_texts() == ["prior", "truth", "icp", "level_set"]
    choose(visit, 1, "start")
    assert legend.all_inner_texts() == ["prior", "truth", "icp", "start"]
    choose(visit, 0, "start")
    assert legend.all_inner_texts() == ["prior", "truth", "start"]  # one contour for one estimate
    visit.page.select_option("#cut", label="none")
    visit.page.select_option("#ghost", label="prior")
    visit.settle()
    of_start = visit.picture(1)
    choose(visit, 1, "icp")  # whose prior has moved along
    assert np.abs(visit.picture(1) - of_start).mean() > 0.05


def test_typed_colours_stay_when_the_estimate_changes(visit: Visit) -> None:
    high = visit.page.locator("#surface-bar .high")
    high.fill("7")
    high.dispatch_event("change")
    choose(visit, 0, "start")
    assert high.input_value() == "7"
    visit.page.select_option("#field", label="posterior standard deviation")
    said = visit.page.locator("figcaption small").first.inner_text()
    assert said.startswith("no posterior standard deviation here")
    choose(visit, 0, "level_set")
    assert visit.page.locator("figcaption small").first.inner_text() == ""


def test_compare_chooses_what_is_shown_first(browser: Any, run: Path, tmp_path: Path) -> None:
    visit = Visit(browser, write_report([run], tmp_path / "page.html", compare=("start", "icp")))
    selects = visit.page.locator("select.estimate")
    assert [selects.nth(k).input_value() for k in (0, 1)] == ["0", "1"]
    assert selects.first.locator("option").count() == 3
    visit.page.close()


def test_equal_arrays_stand_on_the_page_once(tmp_path: Path) -> None:
    """Two estimates that are equal share every array, and all of one prior the triangles."""
    pipeline = Pipeline([Icp(), Icp(as_="again"), LevelSet()])
    data = scene(read_subject([pipeline.run(bulged_case()).write(tmp_path / "run")]))
    start, icp, again, last = (data["meshes"][one["mesh"]] for one in data["estimates"])
    assert icp == again != last
    assert start["faces"] == icp["faces"] == last["faces"]
    assert len(set(data["arrays"])) == len(data["arrays"])


def test_packing_keeps_what_is_no_array() -> None:
    arrays: list[str] = []
    ones = np.ones(3, dtype=np.uint8)
    made = once({"a": [coded(ones), "AQEB"], "b": packed(np.array([0.0, 2.0])), "c": coded(ones)}, arrays)
    assert made == {"a": [0, "AQEB"], "b": {"data": 1, "low": 0.0, "high": 2.0}, "c": 0}
    assert arrays[0] == "AQEB"


def test_estimates_not_shown_first_are_coarser_and_say_so(tmp_path: Path) -> None:
    case = replace(bulged_case(), prior=fine_sphere(36_000), truth=None)
    data = scene(read_subject([finished(tmp_path / "run", case)]))
    start, icp, last = data["estimates"]
    assert (icp["caption"], last["caption"]) == ("", "")
    full, drawn = re.fullmatch(r"(\d+) faces, (\d+) drawn", start["caption"]).groups()  # type: ignore[union-attr]
    assert int(full) == len(case.prior.faces)
    assert int(drawn) <= 10_000


def test_the_value_under_the_pointer_is_that_of_the_surface(visit: Visit, run: Path) -> None:
    """Interpolated in the triangle that the middle of the ball shows from the left; beside it is nothing."""
    centre = json.loads(visit.page.locator("#scene").text_content() or "")["centre"]
    wall = read_subject([run]).surfaces["icp"]
    _, face, _, weights = ClosestPoint(wall.vertices, wall.faces).query(np.array([[20.3, *centre[1:]]]))
    wanted = interpolated(wall.fields["distance_to_truth_mm"], wall.faces[face], weights)[0]
    without_points(visit)
    visit.page.get_by_role("button", name="LL", exact=True).click()
    visit.settle()
    visit.page.mouse.move(*place(visit, 0))
    found = re.fullmatch(r"icp: distance to truth (\S+) mm", line(visit))
    assert found is not None
    assert float(found[1]) == pytest.approx(wanted, abs=0.02)  # three digits, and half a pixel beside
    assert visit.page.locator("#readout").get_attribute("aria-live") == "off"
    visit.page.select_option("#field", label="posterior standard deviation")
    visit.page.mouse.move(*place(visit, 0, 1))
    assert line(visit) == "icp: no posterior standard deviation here"
    visit.page.mouse.move(*place(visit, 1, 0, -10))
    assert re.fullmatch(r"level_set: posterior standard deviation [\d.]+ mm", line(visit))
    visit.page.mouse.move(*place(visit, 0, 26, 22))
    assert line(visit).startswith("Point at a surface")


def test_a_click_keeps_the_place_until_escape_or_a_click_beside(visit: Visit) -> None:
    without_points(visit)
    without_names(visit)
    before = [visit.picture(k) for k in (0, 1)]
    for leave in (lambda: visit.page.keyboard.press("Escape"), lambda: click(visit, 1, 26, 22)):
        click(visit, 0, 3, -3)
        said = line(visit)
        assert said.startswith("icp: distance to truth")
        assert visit.page.locator("#readout").get_attribute("aria-live") == "polite"
        assert all(np.abs(visit.picture(k) - was).max() > 100 for k, was in enumerate(before))
        visit.page.mouse.move(*place(visit, 1, -8, 8))
        assert line(visit) == said
        leave()
        assert line(visit).startswith("Point at a surface")
        for k, was in enumerate(before):
            same_picture(visit.picture(k), was)


def test_many_movements_ask_for_one_frame(visit: Visit) -> None:
    asked = visit.page.evaluate("""() => {
        const [canvas, ask] = [document.querySelector('#panels canvas'), window.requestAnimationFrame];
        let count = 0;
        window.requestAnimationFrame = (act) => { count += 1; return ask(act); };
        for (let k = 0; k < 50; k++)
            canvas.dispatchEvent(new PointerEvent('pointermove', { clientX: 90 + k, clientY: 90 }));
        window.requestAnimationFrame = ask;
        return count;
    }""")
    assert asked == 1


def test_a_drag_pins_nothing(visit: Visit) -> None:
    visit.page.mouse.move(*place(visit, 0))
    visit.page.mouse.down()
    visit.page.mouse.move(*place(visit, 0, 8), steps=4)
    visit.page.mouse.up()
    assert visit.page.locator("#readout").get_attribute("aria-live") == "off"


def test_a_pinned_place_follows_the_colours_and_goes_with_its_surface(visit: Visit) -> None:
    without_points(visit)
    click(visit, 1)
    visit.page.select_option("#field", label="distance to the nearest point")
    assert line(visit).startswith("level_set: distance to the nearest point ")
    choose(visit, 1, "start")
    assert line(visit).startswith("Point at a surface")


def test_what_is_cut_away_is_not_hit(visit: Visit) -> None:
    """In front of the cut through the middle stands nothing: the ray meets the far wall, from within.

    A translucent wall has no cap before it.
    """
    without_points(visit)
    visit.page.locator("#translucent").fill("0.05")
    visit.page.select_option("#field", label="displacement, outward positive")
    visit.page.get_by_role("button", name="LL", exact=True).click()
    visit.settle()
    values = []
    for cut in ("none", "free"):
        visit.page.select_option("#cut", label=cut)
        visit.settle()
        visit.page.mouse.move(*place(visit, 1, len(values)))
        values.append(float(re.fullmatch(r"level_set: .* (\S+) mm", line(visit))[1]))  # type: ignore[index]
    assert values[0] > 2.5
    assert abs(values[1]) < 0.5


def worst_by_hand(run: Path, *, believed: bool = True) -> list[int]:
    """Rows of the fitted points, farthest from the level set first."""
    result = read_subject([run]).last
    points = result.run.points
    rows = np.flatnonzero(points.type == "eam")
    weights = result.estimate.weights
    assert weights is not None
    rows = rows[(weights >= 0.5) == believed]
    return rows[np.argsort(-points.columns["distance_level_set_mm"][rows])].tolist()


def test_the_worst_believed_points_are_listed_and_looked_at(visit: Visit, run: Path) -> None:
    """The outlier, which is by far the farthest, is not among the ten."""
    worst = worst_by_hand(run)[:10]
    points = read_subject([run]).last.run.points
    assert not visit.page.locator("#worst table").is_visible()
    visit.page.locator("#worst summary").click()
    names = visit.page.locator("#worst-rows th").all_inner_texts()
    assert names == [str(700 + row) for row in worst]
    gaps = visit.page.locator("#worst-rows tr td:nth-child(3)").all_inner_texts()
    wanted = points.columns["distance_level_set_mm"][worst]
    np.testing.assert_allclose([float(text.split()[0]) for text in gaps], wanted, rtol=6e-3)  # three digits
    for k in (0, 4):
        visit.page.locator("#worst button").nth(k).press("Enter")
        said = line(visit)
        assert said.startswith(
            f"Point {700 + worst[k]}, eam; {gaps[k]} from level_set; belief 1.00; bipolar "
        )
        assert visit.page.locator("#readout").get_attribute("aria-live") == "polite"
        seen = visit.page.evaluate("document.getElementById('panels').dataset.looksFrom")
        outward = points.xyz[worst[k]] / np.linalg.norm(points.xyz[worst[k]])
        assert np.dot(json.loads(seen), outward) > 0.95  # normals of a ball that bulges


def test_the_list_is_of_the_last_panel_and_outliers_come_last(browser: Any, tmp_path: Path) -> None:
    case = bulged_case(points=10)
    small = finished(tmp_path / "run", replace(case, points=case.points.of("eam", "landmark")))
    visit = Visit(browser, write_report([small]))
    order = [*worst_by_hand(small), *worst_by_hand(small, believed=False)]
    assert len(order) == 10
    visit.page.locator("#worst summary").click()
    assert visit.page.locator("#worst-rows th").all_inner_texts() == [str(row) for row in order]
    assert visit.page.locator("#worst-rows tr").last.inner_text().split()[-2:] == ["0.02", "Look"]
    choose(visit, 1, "start")
    assert visit.page.locator("#worst-name").inner_text() == "start"
    assert visit.page.locator("#worst-rows tr").first.inner_text().split()[-2:] == ["–", "Look"]
    visit.page.close()


def test_a_point_under_the_pointer_is_named(visit: Visit, run: Path) -> None:
    """The point that Look has turned to the viewer is hit where it is drawn; one behind the wall is not."""
    visit.page.locator("#worst summary").click()
    visit.page.locator("#worst button").first.click()
    pinned = line(visit)
    visit.page.keyboard.press("Escape")
    where = visit.page.evaluate("document.getElementById('panels').dataset.looksFrom")
    data = json.loads(visit.page.locator("#scene").text_content() or "")
    offset = read_subject([run]).last.run.points.xyz[worst_by_hand(run)[0]] - data["centre"]
    forward = np.array(json.loads(where))
    right = np.cross([0, 0, 1.0], forward) / np.linalg.norm(np.cross([0, 0, 1.0], forward))
    at = right @ offset, np.cross(forward, right) @ offset
    visit.page.mouse.move(*place(visit, 1, *at))
    assert line(visit) == pinned
    visit.page.evaluate("() => document.querySelector('#panels canvas').focus()")
    for _ in range(18):  # of ten degrees: to the other side
        visit.page.keyboard.press("ArrowLeft")
    visit.settle()
    visit.page.mouse.move(*place(visit, 1, -at[0], at[1]))
    assert pinned.split(",")[0] not in line(visit)


def test_two_clicks_give_a_distance(visit: Visit) -> None:
    """Two places 10 mm to either side of the middle of a ball are 20 mm apart."""
    without_points(visit)
    visit.page.get_by_role("button", name="RL", exact=True).click()  # away from the bulge
    tool = visit.page.locator("#measure")
    tool.click()
    assert tool.get_attribute("aria-pressed") == "true"
    before = [visit.picture(k) for k in (0, 1)]
    click(visit, 1, -10)
    click(visit, 1, 10)
    found = re.fullmatch(r"Distance: (\S+) mm", line(visit))
    assert found is not None
    assert float(found[1]) == pytest.approx(20, abs=0.05 + 2 * PIXEL)  # one decimal is shown
    assert all(np.abs(visit.picture(k) - was).mean() > 0.3 for k, was in enumerate(before))
    click(visit, 0, 5)
    assert line(visit) == "Distance: click where it ends."
    visit.page.keyboard.press("Escape")
    assert tool.get_attribute("aria-pressed") == "false"
    visit.page.mouse.move(5, 5)
    assert line(visit).startswith("Point at a surface")


def test_a_free_cut_lies_across_the_view_that_was_taken(visit: Visit) -> None:
    """It moves with the slider and stays where it is until the direction is taken again."""
    without_points(visit)
    turn = visit.page.locator("#cut-turn")
    assert not turn.is_visible()
    visit.page.get_by_role("button", name="RAO 30", exact=True).click()
    visit.settle()
    visit.page.select_option("#cut", label="free")
    visit.settle()
    open_cut = visit.picture(1)
    legend = visit.page.locator("#legend span").all_inner_texts()
    assert legend == ["prior", "truth", "icp", "level_set"]
    visit.page.locator("#level").fill("0.8")
    visit.settle()
    assert np.abs(visit.picture(1) - open_cut).mean() > 0.5
    visit.page.locator("#level").fill("0.5")
    visit.page.get_by_role("button", name="PA", exact=True).click()
    visit.settle()
    from_behind = visit.picture(1)
    turn.click()
    visit.settle()
    assert np.abs(visit.picture(1) - from_behind).mean() > 0.5


def test_a_free_cut_along_an_axis_is_the_cut_across_it(visit: Visit) -> None:
    """One code path: from RL, x from the other side, a free cut takes away what a sagittal one shows."""
    without_points(visit)
    without_names(visit)
    visit.page.get_by_role("button", name="LL", exact=True).click()
    visit.settle()
    seen = []
    for cut in ("sagittal (x)", "free"):
        visit.page.select_option("#cut", label=cut)
        visit.settle()
        seen.append(visit.picture(1))
    np.testing.assert_allclose(seen[0], seen[1], atol=2)


def test_few_draw_calls_with_everything_on(visit: Visit) -> None:
    visit.page.select_option("#ghost", label="truth")
    visit.page.select_option("#cut", label="axial (z)")
    visit.page.locator("#translucent").fill("0.5")
    visit.settle()
    calls = json.loads(visit.page.evaluate("document.documentElement.dataset.drawCalls"))
    assert len(calls) == 2
    assert all(4 <= count <= MOST_CALLS for count in calls)  # two sides, a ghost, and points
