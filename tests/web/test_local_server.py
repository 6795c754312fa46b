"""The server by itself: pages that do not read, what an answer may do wrong, and its end."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Iterator
from threading import Event

import pytest
from starlette.requests import Request
from starlette.responses import HTMLResponse, StreamingResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from o3dls.errors import InputError
from o3dls.web import server
from o3dls.web.rules import Rule
from o3dls.web.server import LocalServer
from tests.web.asking import Asking

PATIENCE = 1.0  # seconds, in place of those of a user
LARGE = 30_000_000  # bytes, more than a system keeps for a page that does not read


class Own(Asking):
    """A server with one large answer, one without end, and one that breaks."""

    command = "own"

    def __init__(self) -> None:
        self.ended = Event()
        routes = (
            (Rule("GET", "/"), self.large),
            (Rule("GET", "/endless"), self.endless),
            (Rule("GET", "/broken"), self.broken),
            (Rule("GET", "/acting", asker="acting"), self.large),
        )
        self.server = LocalServer(routes, self.command)

    async def large(self, _: Request) -> ASGIApp:
        return HTMLResponse("x" * LARGE)

    async def endless(self, _: Request) -> ASGIApp:
        async def pieces() -> AsyncIterator[str]:
            while True:
                yield "x" * 100_000
                await asyncio.sleep(0)

        async def answer(scope: Scope, receive: Receive, send: Send) -> None:
            try:
                await StreamingResponse(pieces())(scope, receive, send)
            finally:
                self.ended.set()

        return answer

    async def broken(self, _: Request) -> ASGIApp:
        raise RuntimeError("inside")


@pytest.fixture
def own() -> Iterator[Own]:
    made = Own()
    yield made
    made.server.close()


def read_late(connection: socket.socket) -> int:
    """Bytes of what came before the connection was ended."""
    number = 0
    try:
        while piece := connection.recv(1_000_000):
            number += len(piece)
    except ConnectionResetError:
        pass
    return number


def test_a_page_that_does_not_read_is_hung_up_on(own: Own, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "PATIENCE", PATIENCE)
    pages = [own.begin("GET", path, "\r\n\r\n") for path in ("/", "/endless")]
    assert own.ended.wait(10.0)
    time.sleep(PATIENCE)
    for page in pages:
        assert read_late(page) < LARGE
        page.close()


def test_a_page_that_reads_gets_all_however_large_it_is(own: Own) -> None:
    status, text, _ = own.ask("GET", "/")
    assert (status, len(text)) == (200, LARGE)


def test_a_page_that_does_not_read_does_not_hold_up_the_end(own: Own) -> None:
    page = own.begin("GET", "/endless", "\r\n\r\n")
    time.sleep(0.2)
    before = time.monotonic()
    own.server.close()
    assert time.monotonic() - before < 5.0
    assert own.ended.wait(5.0)
    page.close()


def test_what_breaks_is_said_and_the_next_is_answered(own: Own) -> None:
    assert own.ask("GET", "/broken")[:2] == (500, '{"error": "an error inside o3dls; its log says which"}')
    assert own.ask("GET", "/acting?page=a")[0] == 409


def test_where_nobody_has_the_role_nobody_acts(own: Own) -> None:
    assert own.ask("GET", "/acting?page=a")[0] == 409


def test_closing_twice_does_nothing_and_a_taken_port_is_refused(own: Own) -> None:
    for port in (own.server.port, 70_000):
        with pytest.raises(InputError, match=f"port = {port}: cannot be listened on"):
            LocalServer((), "own", port)
    own.server.close()
    own.server.close()
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.1", own.server.port), timeout=2.0)
