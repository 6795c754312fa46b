"""The page of a session in a browser: what it shows as events come, and what it does."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import o3dls
from o3dls.arrays import Array
from o3dls.errors import InputError
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.io.case_reader import read_case
from o3dls.live.messages import action
from o3dls.live.server import LiveServer
from o3dls.live.session import Session, empty
from tests.browser import Visit, violations
from tests.live.scripted import FIRST, Script, script, state
from tests.viewer import FIXTURES

_, _, launch, browser, _ = FIXTURES

TIP = [20.0, -10.0, 5.0]
PATIENCE = 20_000  # ms for what comes at once on a quiet machine


class Played:
    """A server that has told the script's beginning; actions are kept, and those named are refused."""

    def __init__(self, played: Script) -> None:
        self.script, self.done, self.refused = played, [], ""
        self.server = LiveServer(self.act)

    def act(self, action: dict[str, Any]) -> dict[str, Any]:
        if action["do"] == self.refused:
            raise InputError(f"{self.refused}: the disk is full")
        self.done.append(action)
        return {"ok": True, "id": len(self.done)}

    def begin(self) -> Played:
        for event in (self.script.scene, *self.script.points[:FIRST], state(FIRST, tip=TIP)):
            self.server.publish(event)
        return self


@pytest.fixture(scope="module")
def played() -> Script:
    return script(more=3)


@pytest.fixture
def session(played: Script) -> Iterator[Played]:
    made = Played(played).begin()
    yield made
    made.server.close()


@pytest.fixture
def visit(browser: Any, session: Played) -> Iterator[Visit]:
    opened = Visit(browser, session.server.url)
    says(opened, "#role-now", "This page acts.")
    yield opened
    assert [text for text in opened.errors if "willReadFrequently" not in text] == []  # said of these tests
    own = f"http://127.0.0.1:{session.server.port}/"
    assert [url for url in opened.requests if not url.startswith((own, "blob:", "data:"))] == []
    opened.page.close()


def says(visit: Visit, selector: str, text: str) -> None:
    """Wait until an element says a text."""
    visit.page.locator(selector, has_text=re.compile(re.escape(text))).first.wait_for(
        state="attached", timeout=PATIENCE
    )


def drawn(visit: Visit, seq: int) -> Array:
    """The picture once the event of this number was drawn."""
    visit.page.wait_for_function(
        "seq => Number(document.documentElement.dataset.drawn) >= seq", arg=seq, timeout=PATIENCE
    )
    visit.settle()
    return np.asarray(visit.picture(0))


def sequence(session: Played) -> int:
    found = session.server.board.last("surface")
    assert found is not None
    return int(found["seq"])


def press(visit: Visit, name: str) -> None:
    visit.page.get_by_role("button", name=name, exact=True).click()


def test_what_comes_is_shown_without_loading_anew(visit: Visit, session: Played) -> None:
    says(visit, "#points-now", f"{FIRST}, {FIRST} fitted")
    says(visit, "#warning-list", "deform: 20 points are few for a motion")
    assert visit.page.locator("#next-list li").count() == 3
    assert "mapped wall 1.20 mm" in visit.page.locator("#history").get_attribute("aria-label")
    assert "token" not in visit.page.url
    visit.page.evaluate("window.same = true")
    before = visit.picture(0)
    far = session.script.surfaces[-1]
    shifted = {**far, "box": {**far["box"], "low": [at + 5.0 for at in far["box"]["low"]]}}
    session.server.publish(session.script.points[FIRST])
    session.server.publish(shifted)
    session.server.publish(session.script.weights[0])
    session.server.publish(state(FIRST + 1, fit="7 s", source="hung up: no more data"))
    after = drawn(visit, sequence(session))
    assert np.abs(after - before).mean() > 1.0  # of 255: another place of the whole surface
    says(visit, "#points-now", f"{FIRST + 1}, {FIRST + 1} fitted")
    says(visit, "#fit-now", "running for 7 s")
    says(visit, "#source-now", "hung up: no more data")
    assert visit.page.evaluate("window.same")
    assert visit.page.evaluate("document.documentElement.dataset.points") == str(FIRST + 1)


def test_a_session_without_points_says_that_it_waits_for_them(visit: Visit, session: Played) -> None:
    waiting = visit.page.locator("#no-points")
    assert not waiting.is_visible()
    session.server.publish({**state(FIRST), "points": 0, "fitted": 0})
    waiting.wait_for(state="visible", timeout=PATIENCE)
    assert waiting.inner_text() == "Waiting for points: what is shown is the prior."
    session.server.publish(state(FIRST))
    waiting.wait_for(state="hidden", timeout=PATIENCE)


def test_an_opaque_surface_is_painted_in_one_go(visit: Visit) -> None:
    calls = "() => JSON.parse(document.documentElement.dataset.drawCalls)"
    assert visit.page.evaluate(calls) == [2]  # the surface, and all balls
    visit.page.get_by_label("Translucent").fill("0.5")
    visit.settle()
    assert visit.page.evaluate(calls) == [3]


def test_buffers_on_the_graphics_card_do_not_pile_up(visit: Visit, session: Played) -> None:
    visit.page.evaluate("""() => {
        window.alive = 0;
        const { prototype } = WebGL2RenderingContext;
        for (const [name, step] of [['createBuffer', 1], ['deleteBuffer', -1]]) {
            const own = prototype[name];
            prototype[name] = function (...given) { window.alive += step; return own.apply(this, given); };
        }
    }""")
    for k in range(12):
        session.server.publish(session.script.points[FIRST + k % 3])
        session.server.publish(session.script.surfaces[k % 3])
        drawn(visit, sequence(session))
    assert visit.page.evaluate("window.alive") <= 5  # those of the balls, drawn anew each time


def test_a_surface_of_another_scene_is_not_drawn(visit: Visit, session: Played) -> None:
    session.server.publish(state(FIRST + 3))  # its points are in both pictures
    says(visit, "#points-now", f"{FIRST + 3},")
    visit.page.wait_for_timeout(1000)
    before = visit.picture(0)
    far = session.script.surfaces[-1]
    session.server.publish({**far, "of": "another", "box": {**far["box"], "low": [500.0, 0.0, 0.0]}})
    session.server.publish(state(FIRST + 3))
    says(visit, "#points-now", f"{FIRST + 3},")
    visit.settle()
    assert np.abs(visit.picture(0) - before).mean() < 0.5  # as in tests/viewer.py


def test_a_scene_of_the_same_faces_moves_the_picture_and_one_in_another_frame_loads_anew(
    visit: Visit, session: Played
) -> None:
    visit.page.evaluate("window.same = true")
    press(visit, "PA")
    visit.page.wait_for_function("() => location.hash.includes('view=PA')", timeout=PATIENCE)
    session.server.publish({**session.script.scene, "id": "second"})
    session.server.publish({**session.script.surfaces[0], "of": "second"})
    drawn(visit, sequence(session))
    assert visit.page.evaluate("window.same")
    content = session.script.scene["scene"]
    fewer = {**content, "fields": content["fields"][:1]}
    session.server.publish({**session.script.scene, "id": "third", "scene": fewer})
    visit.page.wait_for_function("() => window.same === undefined", timeout=PATIENCE)
    says(visit, "#view-name", "PA")
    session.server.publish(session.script.unplaced)
    visit.page.locator("#unplaced").wait_for(state="visible", timeout=PATIENCE)
    says(visit, "#view-name", "side 1")  # of the prior, whose axes are all that is known
    says(visit, "#role-now", "This page acts.")  # it finds its name again
    assert visit.page.evaluate("document.documentElement.dataset.points") == str(FIRST)


def test_one_page_acts_and_another_looks_until_it_asks(visit: Visit, browser: Any, session: Played) -> None:
    other = Visit(browser, session.server.url)
    says(other, "#role-now", "This page looks on: another page acts.")
    assert other.page.get_by_role("button", name="Undo last").is_disabled()
    assert not other.page.get_by_role("button", name="Act from this page").is_visible()
    visit.page.goto("about:blank")
    other.page.get_by_role("button", name="Act from this page").click(timeout=PATIENCE)
    says(other, "#role-now", "This page acts.")
    press(other, "Undo last")
    says(other, "#answer", "The point is taken back.")
    assert session.done == [{"do": "undo"}]
    other.page.close()


def test_a_page_that_is_opened_again_shows_what_is_now(browser: Any, session: Played) -> None:
    first = Visit(browser, session.server.url)
    first.page.close()
    for event in (session.script.points[FIRST], session.script.surfaces[0], state(FIRST + 1)):
        session.server.publish(event)
    again = Visit(browser, session.server.url)
    says(again, "#points-now", f"{FIRST + 1},")
    assert again.page.evaluate("document.documentElement.dataset.points") == str(FIRST + 1)
    drawn(again, sequence(session))
    again.page.close()


def test_points_are_taken_retyped_labelled_and_taken_back(visit: Visit, session: Played) -> None:
    visit.page.locator("#take-type").select_option("inside")
    press(visit, "Take point")
    says(visit, "#answer", "Point 1 is taken.")
    visit.page.get_by_label("Point", exact=True).fill("7")
    says(visit, "#chosen-now", "eam, bipolar")
    says(visit, "#readout", "Point 7, eam")
    visit.page.locator("#new-type").select_option("outlier")
    press(visit, "Change type")
    says(visit, "#answer", "Point 7 is outlier now.")
    visit.page.get_by_label("value", exact=True).fill("0.25")
    press(visit, "Set")
    says(visit, "#answer", "Point 7 is labelled.")
    press(visit, "Take back")
    says(visit, "#answer", "The point is taken back.")
    assert session.done == [
        {"do": "take", "xyz": TIP, "type": "inside"},
        {"do": "retype", "point": 7, "type": "outlier"},
        {"do": "label", "point": 7, "values": {"bipolar": 0.25}},
        {"do": "undo", "point": 7},
    ]
    session.server.publish({**session.script.points[6], "undone": True})
    says(visit, "#chosen-now", "There is no such point.")
    assert visit.page.get_by_role("button", name="Take back").is_disabled()


def test_what_a_session_takes_back_is_gone_from_open_and_new_pages(
    visit: Visit, browser: Any, session: Played
) -> None:
    """The event is the one that a session makes of an undone point."""
    made = Session(empty(read_case(Path(o3dls.__file__).parent / "demo_case")))
    for one in _takes(session.script):
        made.apply(action(one))
    last = made.apply({"do": "undo"})
    assert last == FIRST
    session.server.publish({"event": "point", **made.points[last].record()})
    wanted = f"() => document.documentElement.dataset.points === '{FIRST - 1}'"
    visit.page.wait_for_function(wanted, timeout=PATIENCE)
    later = Visit(browser, session.server.url)
    later.page.wait_for_function(wanted, timeout=PATIENCE)
    later.page.close()


def _takes(played: Script) -> list[dict[str, Any]]:
    return [{"do": "take", "xyz": one["xyz"]} for one in played.points[:FIRST]]


def test_notes_are_listed_apart_from_warnings(visit: Visit, session: Played) -> None:
    note = {"code": "order-lost", "stage": "deform", "kind": "note", "text": "the order is lost"}
    doubt = {"code": "map-shift", "stage": "deform", "kind": "warning", "text": "a part is shifted"}
    for told, none in (([note], True), ([note, doubt], False)):
        session.server.publish(state(FIRST, warnings=told))
        says(visit, "#note-list", "deform: the order is lost")
        assert visit.page.locator("#no-warnings").is_visible() == none
    says(visit, "#warning-list", "deform: a part is shifted")
    assert visit.page.locator("#warning-list li").count() == 1


def test_before_the_first_fit_the_surface_is_said_to_be_the_priors(visit: Visit, session: Played) -> None:
    session.server.publish(state(FIRST, fitted=0))
    says(visit, "#connection", "no point is fitted yet; the surface is the prior in its first pose")
    session.server.publish(state(FIRST))
    says(visit, "#connection", "what is shown is now")


def test_an_old_fit_is_said_and_can_be_made_again(visit: Visit, session: Played) -> None:
    says(visit, "#connection", "what is shown is now")
    session.server.publish(state(FIRST + 3, behind=3))
    says(visit, "#connection", "its last full fit is 3 points old")
    says(visit, "#fit-now", "the last knew 3 points less")
    press(visit, "Fit again")
    says(visit, "#answer", "A full fit begins")
    assert session.done == [{"do": "fit"}]
    session.server.publish({"event": "progress", "text": "deform: fold 2 of 5"})
    says(visit, "#ended", "deform: fold 2 of 5")


def test_the_tip_is_drawn_and_without_one_no_point_can_be_taken(visit: Visit, session: Played) -> None:
    take = visit.page.get_by_role("button", name="Take point")
    says(visit, "#tip-now", "Tip at 20.0, -10.0, 5.0")
    with_tip = visit.picture(0)
    session.server.publish({"event": "tip", "xyz": None})
    says(visit, "#tip-now", "No live tip")
    assert take.is_disabled()
    visit.settle()
    assert (visit.picture(0) != with_tip).any()
    session.server.publish({"event": "tip", "xyz": TIP})
    says(visit, "#tip-now", "Tip at 20.0")
    assert take.is_enabled()


def test_a_point_is_picked_in_the_picture(visit: Visit, session: Played) -> None:
    middle = {"id": 99, "xyz": session.script.scene["scene"]["centre"], "type": "inside", "values": {}}
    visit.page.get_by_label("Translucent").fill("0.9")
    for other in session.script.points[:FIRST]:
        session.server.publish({**other, "undone": True})
    session.server.publish({"event": "point", **middle})
    visit.page.wait_for_function("() => document.documentElement.dataset.points === '1'", timeout=PATIENCE)
    visit.settle()
    visit.page.locator("#panels canvas").click()
    says(visit, "#readout", "Point 99, inside")
    assert visit.page.get_by_label("Point", exact=True).input_value() == "99"


def test_what_is_refused_is_said(visit: Visit, session: Played) -> None:
    session.refused = "undo"
    press(visit, "Undo last")
    says(visit, "#answer.refused", "Refused: undo: the disk is full")
    session.server.publish({"event": "error", "text": "the source sent garbage"})
    says(visit, "#answer.refused", "Refused: the source sent garbage")
    press(visit, "Next point is this landmark")
    says(visit, "#answer.refused", "Refused: a landmark needs a name")
    assert [one for one in visit.errors if "422" not in one] == []
    visit.errors.clear()  # the browser's own word for a status


def test_a_landmark_is_placed_on_the_prior_by_a_click_and_by_keys(visit: Visit, session: Played) -> None:
    prior = read_case(Path(o3dls.__file__).parent / "demo_case").prior
    visit.page.get_by_label("Name", exact=True).fill("LAA")
    visit.page.locator("#panels canvas").click()
    says(visit, "#place-now", "Chosen on the prior")
    press(visit, "Place on the prior")
    says(visit, "#answer", "LAA is placed on the prior.")
    visit.page.locator("#panels canvas").focus()
    visit.page.keyboard.press("ArrowRight")
    button = visit.page.get_by_role("button", name="Choose the middle of the picture")
    button.focus()
    visit.page.keyboard.press("Enter")
    visit.page.get_by_role("button", name="Place on the prior").focus()
    visit.page.keyboard.press("Enter")
    visit.page.wait_for_timeout(300)
    press(visit, "Next point is this landmark")
    says(visit, "#answer", "The next point is LAA.")
    clicked, chosen, following = session.done
    assert following == {"do": "landmark", "name": "LAA", "next": True}
    places = np.array([clicked["xyz"], chosen["xyz"]])
    gaps = np.sqrt(ClosestPoint(prior.vertices, prior.faces).query(places)[0])
    assert gaps.max() < 0.3  # mm: the page has fewer faces than the prior
    assert np.linalg.norm(places[0] - places[1]) > 1.0  # the picture was turned by 10 degrees


def test_the_end_is_asked_for_once_and_links_the_report(
    visit: Visit, session: Played, tmp_path: Path
) -> None:
    (tmp_path / "report.html").write_text("<p>the report of the run</p>", encoding="utf-8")
    (tmp_path / "run.json").write_text("{}", encoding="utf-8")
    press(visit, "End session")
    visit.page.get_by_role("dialog").get_by_role("button", name="Go on").click()
    assert session.done == []
    press(visit, "End session")
    visit.page.get_by_role("dialog").get_by_role("button", name="End session").click()
    says(visit, "#answer", "The session ends")
    assert session.done == [{"do": "end"}]
    session.server.publish({"event": "end", "run": str(tmp_path), "case": "the/case"})
    says(visit, "#ended", "the case in the/case")
    assert visit.page.get_by_role("button", name="Undo last").is_disabled()


def test_a_page_comes_back_by_itself_and_misses_nothing(visit: Visit, session: Played) -> None:
    says(visit, "#connection", "Connected")
    visit.page.evaluate("window.same = true")
    session.server.pages.close()
    for event in session.script.points[FIRST : FIRST + 3]:
        session.server.publish(event)
    visit.page.wait_for_function(
        "count => document.documentElement.dataset.points === String(count)", arg=FIRST + 3, timeout=PATIENCE
    )
    says(visit, "#connection", "Connected")
    assert visit.page.evaluate("window.same")


def test_a_lost_connection_is_said(browser: Any, session: Played) -> None:
    opened = Visit(browser, session.server.url)
    says(opened, "#connection", "Connected")
    session.server.close()
    says(opened, "#connection", "Connection lost: what is shown is old.")
    assert opened.page.get_by_role("button", name="Undo last").is_disabled()
    opened.page.close()


def test_before_a_pose_points_are_not_drawn_into_another_frame(browser: Any, played: Script) -> None:
    session = Played(played)
    for event in (played.unplaced, *played.points[:5]):
        session.server.publish(event)
    opened = Visit(browser, session.server.url)
    opened.page.locator("#unplaced").wait_for(state="visible", timeout=PATIENCE)
    opened.page.wait_for_function("() => document.documentElement.dataset.points === '5'", timeout=PATIENCE)
    assert not opened.page.locator("#point-bar").is_visible()
    opened.page.close()
    session.server.close()


def test_without_webgl_all_but_the_picture_works(launch: Callable[..., Any], session: Played) -> None:
    opened = Visit(launch(webgl=False), session.server.url, wait=False)
    says(opened, "#waiting", "no WebGL")
    says(opened, "#points-now", f"{FIRST},")
    press(opened, "Undo last")
    says(opened, "#answer", "The point is taken back.")
    opened.page.close()


@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (390, "dark")])
def test_the_page_is_accessible_and_fits(browser: Any, session: Played, width: int, scheme: str) -> None:
    opened = Visit(browser, session.server.url, width=width, color_scheme=scheme)
    says(opened, "#role-now", "This page acts.")
    assert violations(opened) == []
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= width
    assert "Research use only" in opened.page.locator("header").inner_text()
    press(opened, "End session")
    assert violations(opened) == []
    opened.page.close()


def test_every_state_of_the_numbers_is_drawn(visit: Visit, session: Played) -> None:
    for history in (
        [],
        [[10, None, None]],
        [[10, 1.0, None]],
        [[10, 1.0, 1.0]],
        [[10, 0.0, 0.0], [11, 2.0, 2.01]],
    ):
        session.server.publish(state(FIRST, history=history, next=[], ended="no place is left", warnings=[]))
        says(visit, "#next-ended", "no place is left")
        visit.settle()
    assert visit.page.locator("#warning-list").is_hidden()
    texts = visit.page.locator("#history text")
    heights = {
        texts.nth(k).inner_html(): float(texts.nth(k).get_attribute("y") or 0) for k in range(texts.count())
    }
    assert abs(heights["mapped"] - heights["unmapped"]) >= 12  # names beside each other stay readable


def test_the_report_is_served_once_the_session_has_ended(session: Played, tmp_path: Path) -> None:
    from tests.finished import finished

    run = finished(tmp_path / "run")
    session.server.publish({"event": "end", "run": str(run), "case": str(run / "case")})
    import http.client

    host = f"127.0.0.1:{session.server.port}"
    asked = http.client.HTTPConnection(host)
    cookie = f"o3dls_live_{session.server.port}={session.server.token}"
    asked.request("GET", "/report", headers={"Cookie": cookie})
    assert b"Side by side" in asked.getresponse().read()
    asked.close()
