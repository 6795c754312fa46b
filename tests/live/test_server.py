"""The server of a session's pages: whom it answers, what it refuses, and in which order events come."""

from __future__ import annotations

import http.client
import json
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

import o3dls.cli.live as live_command
from o3dls.errors import InputError
from o3dls.live.routes import MOST_PAGES
from o3dls.live.server import LiveServer
from o3dls.web import server as web_server
from tests.live.test_board import point
from tests.web.asking import Asking, until

RESEARCH = "Research use only"


class Session(Asking):
    """A server whose actions are written down; what the action `refuse` does is refused."""

    command = "live"

    def __init__(self) -> None:
        self.done: list[dict[str, Any]] = []
        self.server = LiveServer(self.act)

    def act(self, action: dict[str, Any]) -> dict[str, Any]:
        if action.get("do") == "refuse":
            raise InputError("refuse: there is no point 7")
        if action.get("do") == "break":
            raise RuntimeError("inside")
        self.done.append(action)
        return {"ok": True, "id": len(self.done)}


class Page:
    """The events of one page, over a plain connection."""

    def __init__(self, session: Session, name: str = "a", last: str = "") -> None:
        host = f"127.0.0.1:{session.server.port}"
        self.connection = http.client.HTTPConnection(host, timeout=10)
        headers = {"Cookie": session.cookie, "Last-Event-ID": last}
        self.connection.request("GET", f"/events?page={name}", headers=headers)
        self.answer = self.connection.getresponse()
        self.last = last

    def read(self) -> dict[str, Any]:
        """The next event; signs of life are passed over."""
        lines: list[str] = []
        while True:
            line = self.answer.readline().decode().rstrip("\n")
            if line:
                lines.append(line)
            elif fields := dict(one.split(": ", 1) for one in lines if not one.startswith((":", "retry"))):
                self.last = fields.get("id", self.last)
                return dict(json.loads(fields["data"]))
            else:
                lines = []

    def until(self, kind: str) -> dict[str, Any]:
        while (event := self.read())["event"] != kind:
            pass
        return event

    def close(self) -> None:
        self.answer.close()
        self.connection.close()


@pytest.fixture
def session() -> Iterator[Session]:
    made = Session()
    yield made
    made.server.close()


@pytest.fixture
def page(session: Session) -> Iterator[Page]:
    opened = Page(session)
    opened.until("role")
    yield opened
    opened.close()


def test_the_link_opens_the_page_and_leaves_a_cookie_that_no_script_reads(session: Session) -> None:
    path = "/" + session.server.url.partition("/?")[2].join(["?", ""])
    status, text, headers = session.ask("GET", path, Cookie=None)
    assert status == 200
    assert RESEARCH in text
    assert "HttpOnly; SameSite=Strict" in headers["set-cookie"]
    assert session.ask("GET", "/")[0] == 200  # the cookie is enough from then on


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b'{"do": "take", "xyz": [NaN, 0, 0]}', 400),
        (b'{"do": "take", "xyz": [%s, 1, 2]}' % (b"9" * 400), 400),
        (b'{"do": "take", "xyz": [%s, 1, 2]}' % (b"9" * 5000), 400),
    ],
)
def test_a_number_that_no_reader_takes_is_refused(
    session: Session, page: Page, body: bytes, status: int
) -> None:
    found, text, _ = session.ask("POST", "/act", body)
    assert found == status
    assert json.loads(text)["error"]
    assert session.done == []


def test_there_is_no_report_before_the_end(session: Session) -> None:
    status, text, _ = session.ask("GET", "/report")
    assert (status, "before the session has ended" in text) == (404, True)


def test_the_page_that_acts_is_answered_and_another_looks_on(session: Session, page: Page) -> None:
    status, text, _ = session.ask("POST", "/act", {"do": "undo"})
    assert (status, json.loads(text)) == (200, {"ok": True, "id": 1})
    other = Page(session, "b")
    assert other.until("role") == {"event": "role", "acts": False, "free": False}
    assert session.ask("POST", "/act", {"do": "undo"}, X_Page="b")[0] == 409
    assert session.ask("POST", "/role", {}, X_Page="b")[0] == 409
    page.close()
    while not other.until("role")["free"]:
        pass
    assert session.ask("POST", "/role", {}, X_Page="b")[0] == 200
    assert other.until("role")["acts"]
    assert session.ask("POST", "/act", {"do": "undo"}, X_Page="b")[0] == 200
    other.close()


def test_what_the_session_refuses_is_said_and_what_breaks_too(session: Session, page: Page) -> None:
    status, text, _ = session.ask("POST", "/act", {"do": "refuse"})
    assert (status, json.loads(text)["error"]) == (422, "refuse: there is no point 7")
    status, text, _ = session.ask("POST", "/act", {"do": "break"})
    assert (status, json.loads(text)["error"]) == (500, "an error inside o3dls; its log says which")


def test_events_come_in_order_and_none_is_lost_at_ten_points_a_second(session: Session, page: Page) -> None:
    for k in range(50):  # five times as fast: what holds then holds at ten
        session.server.publish(point(k + 1))
        session.server.publish({"event": "surface", "after": k + 1})
        time.sleep(0.02)
    numbers = [page.until("point")["id"] for _ in range(50)]
    assert numbers == list(range(1, 51))


def test_a_page_that_comes_back_gets_what_it_missed(session: Session, page: Page) -> None:
    session.server.publish(point(1))
    page.until("point")
    page.close()
    for k in (2, 3):
        session.server.publish(point(k))
    again = Page(session, "a", page.last)
    assert [again.until("point")["id"] for _ in range(2)] == [2, 3]
    again.close()


def test_a_page_that_does_not_read_stops_nobody(session: Session) -> None:
    slow = socket.create_connection(("127.0.0.1", session.server.port))
    host = f"127.0.0.1:{session.server.port}"
    slow.sendall(
        f"GET /events?page=slow HTTP/1.1\r\nHost: {host}\r\nCookie: {session.cookie}\r\n\r\n".encode()
    )
    reader = Page(session, "b")
    reader.until("role")
    before = time.monotonic()
    for k in range(2000):
        session.server.publish(point(k + 1, values={"note": "x" * 2000}))
    assert time.monotonic() - before < 2.0  # 4 MB; waiting for the slow one would take its 10 s of patience
    session.server.publish({"event": "state", "points": 2000})
    assert reader.until("state")["points"] == 2000
    slow.close()
    reader.close()


def test_a_page_that_does_not_read_loses_its_place(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web_server, "PATIENCE", 1.0)
    slow = session.begin("GET", "/events?page=slow", "\r\n\r\n")
    until(lambda: session.server.pages.number == 1)

    def has_gone() -> bool:
        session.server.publish({"event": "surface", "positions": "x" * 1_000_000})
        return not session.server.pages.number

    until(has_gone)
    slow.close()


def test_more_pages_than_a_browser_can_serve_are_refused(session: Session) -> None:
    pages = [Page(session, f"p{k}") for k in range(MOST_PAGES)]
    for one in pages:
        one.until("role")
    assert session.ask("GET", "/events?page=more")[0] == 503
    for one in pages:
        one.close()


def test_the_server_waits_for_a_page_that_is_open_or_loads_anew(session: Session) -> None:
    page = Page(session)
    page.until("role")
    waiting = Thread(target=session.server.wait)
    waiting.start()
    page.close()
    time.sleep(1.2)  # a beat: it was seen to have gone
    again = Page(session)
    waiting.join(2.5)
    assert waiting.is_alive()
    again.close()
    waiting.join(10.0)
    assert not waiting.is_alive()


def test_the_server_does_not_wait_where_no_page_is_open(session: Session) -> None:
    before = time.monotonic()
    session.server.wait()
    assert time.monotonic() - before < 1.0


def test_the_command_serves_the_report_until_its_page_is_closed() -> None:
    session, tellers = Session(), []  # type: ignore[var-annotated]
    opened: list[Page] = []

    def serve() -> None:
        with live_command._serve_page(session, tellers, 0, opened=None):  # type: ignore[arg-type]
            session.server.close()
            session.server = tellers[0].__self__
            opened.append(Page(session))
            opened[0].until("role")

    serving = Thread(target=serve)
    serving.start()
    serving.join(4.0)
    assert serving.is_alive()
    assert session.ask("GET", "/")[0] == 200
    opened[0].close()
    serving.join(10.0)
    assert not serving.is_alive()


def test_a_browser_is_led_to_the_page_by_a_file_of_this_user_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arguments of a process are seen by every user of the machine."""
    launched: list[str] = []
    monkeypatch.setattr("click.launch", launched.append)
    session, tellers = Session(), []  # type: ignore[var-annotated]
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "page.html").symlink_to(tmp_path / "mine")
    with live_command._serve_page(session, tellers, 0, opened=tmp_path):  # type: ignore[arg-type]
        session.server.close()
        session.server = tellers[0].__self__
        (given,) = launched
        assert session.server.token not in given
        file = Path(given)
        assert file.parent == tmp_path.resolve()
        assert file.stat().st_mode & 0o777 == 0o600
        (link,) = re.findall(r'url=([^"]*)"', file.read_text())
        assert link == session.server.url
        assert (
            session.ask("GET", link.removeprefix(f"http://127.0.0.1:{session.server.port}"), Cookie=None)[0]
            == 200
        )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine"]
    assert (tmp_path / "mine").read_text() == "mine"


def test_the_end_lets_pages_go_and_closing_twice_does_nothing() -> None:
    session = Session()
    page = Page(session)
    page.until("role")
    session.server.close()
    session.server.close()
    assert page.answer.read() in (b"", b": here\n\n")  # it ends, if need be after a sign of life
    page.close()


def test_a_taken_port_is_refused(session: Session) -> None:
    for port in (session.server.port, 70_000):
        with pytest.raises(InputError, match=f"port = {port}: cannot be listened on"):
            LiveServer(session.act, port=port)


def test_a_session_without_a_page_loads_no_server() -> None:
    code = (
        "import sys; from o3dls.cli import live; from o3dls.live import host, record, finish;"
        "from o3dls.live.sources import stdin; print(sorted({'starlette', 'uvicorn'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
