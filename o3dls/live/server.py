"""The server of a session's pages: HTTP on this machine alone, with server-sent events."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from http.server import ThreadingHTTPServer
from threading import Lock, Thread
from time import monotonic, sleep
from typing import Any

from ..errors import InputError
from ..web.rules import NAMES
from .board import Board, Box, Event, Sent
from .handler import Handler
from .roles import Roles

ANEW = 2.0  # seconds in which a page that loads anew is back
LOOK = 0.1  # seconds between two looks at whether pages are open
Act = Callable[[dict[str, Any]], dict[str, Any]]


class LiveServer:
    """This server shows the pages of one session, from when it is made until `close`.

    act(action) gives {"ok": true, ...}, or {"error": text} for what was refused; it is called from several
    threads, one at a time. Raises InputError where the host is not this machine, or the port is taken.
    """

    def __init__(self, act: Act, host: str = "127.0.0.1", port: int = 0) -> None:
        if host not in NAMES:
            raise InputError(f"host = '{host}': the page is served to this machine alone: {NAMES[0]}")
        self.board, self.roles = Board(), Roles()
        self.token = secrets.token_urlsafe(24)
        self._act, self._acting = act, Lock()
        self._boxes: dict[int, tuple[Box, str]] = {}
        self._lock = Lock()
        self._server = self._open_server(port)
        self.port = int(self._server.server_address[1])
        self._thread = Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The link to the page, with the token without which nothing is answered."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    def publish(self, event: Event) -> None:
        """Send an event to all pages. Returns at once, however slow they are.

        An event is a dict with its kind as `event`; its `seq` is given here. Raises ValueError where a number
        in it is not finite.
        """
        self.board.publish(event)

    def act(self, action: dict[str, Any]) -> dict[str, Any]:
        """Do an action of the page that acts, and return what comes of it."""
        with self._acting:
            return self._act(action)

    def enter(self, page: str, last: str) -> Box:
        """Connect a page."""
        box = self.board.join(last)
        self.roles.enter(page)
        with self._lock:
            self._boxes[id(box)] = (box, page)
        self.tell_roles()
        return box

    def leave(self, page: str, box: Box) -> None:
        """Disconnect a page that has gone."""
        self.board.leave(box)
        with self._lock:
            self._boxes.pop(id(box), None)
        self.roles.leave(page)
        self.tell_roles()

    def ask_role(self, page: str) -> bool:
        """Ask for the role that acts, and return whether the page has it now."""
        granted = self.roles.ask(page)
        self.tell_roles()
        return granted

    def tell_roles(self) -> None:
        """Say to every page whether it acts, and whether it may ask to."""
        with self._lock:
            pages = list(self._boxes.values())
        for box, page in pages:
            acts = str(self.roles.acts(page)).lower()
            free = str(self.roles.free()).lower()
            box.put(Sent(0, "role", f'{{"event":"role","acts":{acts},"free":{free}}}'))

    @property
    def pages(self) -> int:
        """How many pages are connected."""
        return len(self._boxes)

    def wait(self) -> None:
        """Return once no page is open any more: after the end of a session, so that its report can be read. A
        page that loads anew is not gone.
        """
        gone = monotonic() - (0.0 if self.pages else ANEW)
        while self.pages or monotonic() - gone < ANEW:
            gone = monotonic() if self.pages else gone
            sleep(LOOK)

    def close(self) -> None:
        """Let every page go and stop. A second time does nothing."""
        with self._lock:
            pages = list(self._boxes.values())
        for box, _ in pages:
            box.close()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(5.0)

    def _open_server(self, port: int) -> ThreadingHTTPServer:
        class Own(Handler):
            live = self

        try:
            return _Server(("127.0.0.1", port), Own)
        except (OSError, OverflowError) as error:
            raise InputError(f"port = {port}: cannot be listened on: {error}") from error


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False  # a page that does not read must not hold up the end

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log that a page went away in the middle of an answer: it is no error of ours."""
        import logging

        logging.getLogger("o3dls").debug("live: a request of %s broke off", client_address, exc_info=True)
