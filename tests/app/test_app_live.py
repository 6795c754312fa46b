"""A live session that is begun on the page of a case."""

from __future__ import annotations

import json
import shlex
import shutil
import urllib.request
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.error import URLError

import pytest

from o3dls.app.live_session import Sessions
from o3dls.io.case_writer import write_case
from o3dls.live.journal import read_journal
from tests.app.served import Served, served
from tests.browser import Visit, violations
from tests.tiny import ball_case
from tests.viewer import FIXTURES
from tests.web.asking import until

_, _, launch, browser, _ = FIXTURES

BEGUN = 120_000  # ms


@pytest.fixture
def app(tmp_path: Path) -> Iterator[Served]:
    folder = tmp_path / "work"
    for name in ("first", "second"):
        write_case(folder / "cases" / name, ball_case())
    (folder / "comes.csv").write_text("x,y,z,type\n")
    with served(folder) as made:
        yield made


def asked(case: str, **more: str) -> dict[str, str]:
    return {"case": case, "source": "watch", "place": "comes.csv", **more}


def is_served(link: str) -> bool:
    try:
        with urllib.request.urlopen(link, timeout=60) as answer:
            return "<title>o3dls live</title>" in answer.read().decode()
    except URLError:
        return False


def test_a_session_of_a_case_is_that_of_the_command_and_ends_with_the_app(app: Served) -> None:
    begun = app.act("/live", asked("cases/first"))
    assert begun["record"] == "live/first"
    line = "o3dls live cases/first --watch comes.csv --record live/first"
    assert shlex.split(begun["command"]) == shlex.split(line)
    assert is_served(begun["link"])
    assert app.act("/live", asked("cases/first"))["link"] == begun["link"]  # one session, found again
    status, text, _ = app.ask("POST", "/live", asked("cases/second"))
    assert (status, "cases/first: a live session of it is open" in json.loads(text)["error"]) == (422, True)
    app.close()
    assert not is_served(begun["link"])
    points = ball_case().points
    kept = read_journal(app.folder / "live" / "first" / "journal.jsonl").actions
    assert sum(one["do"] == "take" for one in kept) == int((points.type != "landmark").sum())


def test_what_the_command_refuses_is_said_and_the_next_session_begins(app: Served) -> None:
    spoilt = app.folder / "cases" / "spoilt"
    shutil.copytree(app.folder / "cases" / "first", spoilt)
    (spoilt / "points.csv").write_text("x,y\n1,2\n")
    status, text, _ = app.ask("POST", "/live", asked("cases/spoilt"))
    assert status == 422
    assert "points.csv" in json.loads(text)["error"]
    assert "Traceback" not in text
    assert is_served(app.act("/live", asked("cases/second"))["link"])


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"source": "replay"}, "source = 'replay': must be one of watch, igtl"),
        ({"place": "../comes.csv"}, "folder"),
        ({"place": "none.csv"}, "--watch none.csv: no such file"),
        ({"source": "igtl", "place": "--help"}, "must be HOST:PORT"),
        ({"place": ""}, "place"),
    ],
    ids=["kind", "outside", "missing", "address", "empty"],
)
def test_a_source_that_cannot_be_is_refused(app: Served, given: dict[str, str], sentence: str) -> None:
    status, text, _ = app.ask("POST", "/live", asked("cases/first", **given))
    assert (status, sentence in json.loads(text)["error"]) == (422, True), text
    assert not (app.folder / "live").exists()


def test_a_session_that_has_ended_is_followed_by_one_with_a_record_of_its_own(app: Served) -> None:
    with closing(Sessions(app.desk.shelf)) as sessions:
        first = sessions.begin(Path("cases/first"), "watch", "comes.csv")
        sessions.close()
        again = sessions.begin(Path("cases/second"), "igtl", "localhost:1")
        assert (first["record"], again["record"]) == ("live/first", "live/second")
        sessions.close()
        assert sessions.begin(Path("cases/first"), "watch", "comes.csv")["record"] == "live/first_2"


def test_a_session_begins_by_a_button_and_is_used_on_its_own_page(browser: Any, app: Served) -> None:
    visit = Visit(browser, app.server.url, wait=False)
    page = visit.page
    page.click("text=cases/first")
    page.get_by_label("Its path in the folder of the app").fill("comes.csv")
    page.click("#begin-live")
    link = page.locator("#live-said a")
    link.wait_for(timeout=BEGUN)
    assert "live/first" in page.locator("#live-said").inner_text()
    assert link.evaluate("one => one === document.activeElement")
    assert violations(visit) == []
    with page.expect_popup() as opened:
        page.keyboard.press("Enter")
    session = opened.value
    session.locator("#connection", has_text="Connected").wait_for(timeout=BEGUN)
    session.set_viewport_size({"width": 390, "height": 800})
    assert session.evaluate("document.documentElement.scrollWidth <= innerWidth")
    number = int((ball_case().points.type != "landmark").sum())
    with (app.folder / "comes.csv").open("a") as file:
        file.write("1.5,2.5,30,eam\n")
    session.locator("#points-now", has_text=f"{number + 1},").wait_for(timeout=BEGUN)
    session.close()
    page.close()
    until(lambda: (app.folder / "live" / "first" / "journal.jsonl").is_file())
