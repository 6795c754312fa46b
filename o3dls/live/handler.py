"""What a page may ask of the server, and what everything else is told; whom it answers say the rules of all
our servers.
"""

from __future__ import annotations

import json
import logging
import select
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit

from ..errors import InputError, O3dlsError
from ..web.rules import HEADERS, PATIENCE, Refusal, check_sender, check_token, cookie_line
from .board import Board, Box, Sent
from .messages import MOST, parse_action
from .page import live_page
from .roles import Roles

COMMAND = "live"
PAGES = 5  # a browser opens six connections to one server, and an action needs one
BEAT = 1.0  # seconds after which a silent page is sent a sign of life
RETRY = 1000  # ms after which a page that lost its connection comes back
LONGEST = 20  # digits of a length; Python reads a number of at most 4300
DRAIN = 1_000_000  # bytes of a body that is too long are read, so that the page hears why it is refused
NAME = 64  # letters of a page's name, at most
log = logging.getLogger("o3dls")
PATHS = {"/": "GET", "/events": "GET", "/report": "GET", "/act": "POST", "/role": "POST"}


class Pages(Protocol):
    """This protocol says what a request needs of the server, `server.LiveServer`."""

    board: Board
    roles: Roles
    token: str
    port: int

    @property
    def pages(self) -> int: ...

    def act(self, action: dict[str, Any], /) -> dict[str, Any]: ...

    def ask_role(self, page: str, /) -> bool: ...

    def enter(self, page: str, last: str, /) -> Box: ...

    def leave(self, page: str, box: Box, /) -> None: ...


class Handler(BaseHTTPRequestHandler):
    """A handler answers one request. `live` is the server whose pages ask."""

    live: Pages
    timeout = PATIENCE
    server_version, sys_version = "o3dls", ""
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        self._answer_request("GET")

    def do_POST(self) -> None:
        self._answer_request("POST")

    def do_other(self) -> None:
        self._answer_request(self.command)

    do_PUT = do_DELETE = do_PATCH = do_HEAD = do_OPTIONS = do_TRACE = do_CONNECT = do_other

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: the link holds the token."""

    def _answer_request(self, method: str) -> None:
        try:
            self._route_request(method)
        except Refusal as refusal:
            self._send_json(refusal.status, {"error": str(refusal)})
        except O3dlsError as error:
            self._send_json(422, {"error": str(error)})
        except OSError:
            raise  # the page went away
        except Exception:  # the page must hear that its action failed
            log.exception("live: %s failed", method)
            self._send_json(500, {"error": "an error inside o3dls; its log says which"})

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer what the base class refuses: broken requests and methods without a name here."""
        self.command = self.command or ""
        self._send_json(405 if code == 501 else code, {"error": message or "no request that is understood"})

    def _route_request(self, method: str) -> None:
        try:
            asked = urlsplit(self.path)
        except ValueError as error:  # such as half an address in brackets
            raise Refusal(400, "the path is no address") from error
        given = parse_qs(asked.query)
        self._check_asker(given.get("token", [""])[0] if asked.path == "/" else "")
        if asked.path not in PATHS:
            raise Refusal(404, "there is no such page")
        if method != PATHS[asked.path]:
            raise Refusal(405, f"{asked.path} takes {PATHS[asked.path]} alone")
        if asked.path == "/":
            self._send_page()
        elif asked.path == "/events":
            self._stream_events(self._check_page_name(given.get("page", [""])[0]))
        elif asked.path == "/report":
            self._send_report()
        else:
            self._answer_post(asked.path, self._check_page_name(self.headers.get("X-Page", "")))

    def _check_asker(self, token: str) -> None:
        """Raise Refusal for whom the rules of our servers do not answer; token: the one of the link."""
        live, headers = self.live, self.headers
        check_sender(live.port, self.command, headers.get("Host", ""), headers.get("Origin"))
        check_token(COMMAND, live.port, live.token, token, headers.get("Cookie", ""))

    def _check_page_name(self, page: str) -> str:
        if not (page.isascii() and page.isalnum() and len(page) <= NAME):
            raise Refusal(400, "a page must name itself in letters and digits")
        return page

    def _send_page(self) -> None:
        cookie = cookie_line(COMMAND, self.live.port, self.live.token)
        self._send_html(live_page(), {"Set-Cookie": cookie})

    def _send_report(self) -> None:
        from ..report.browser import page_of

        ended = self.live.board.last("end")
        if not ended or not ended.get("run"):
            raise Refusal(404, "there is no report before the session has ended")
        self._send_html(page_of(Path(ended["run"])).read_text(encoding="utf-8"), {})

    def _answer_post(self, path: str, page: str) -> None:
        content = self._read_body()
        if path == "/role":
            granted = self.live.ask_role(page)
            self._send_json(
                200 if granted else 409, {"ok": True} if granted else {"error": "another page acts"}
            )
            return
        if not self.live.roles.acts(page):
            raise Refusal(409, "this page looks on: another page acts")
        found = self.live.act(content)
        self._send_json(422 if "error" in found else 200, found)

    def _read_body(self) -> dict[str, Any]:
        if self.headers.get_content_type() != "application/json":
            raise Refusal(415, "an action is sent as application/json")
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdecimal()):
            raise Refusal(411, "an action must say its length")
        if len(length) > LONGEST:
            raise Refusal(413, f"an action may have {MOST} bytes")
        if (size := int(length)) > MOST:
            self.rfile.read(min(size, DRAIN))
            raise Refusal(413, f"an action may have {MOST} bytes")
        try:
            found = parse_action(self.rfile.read(size), "an action")
        except InputError as error:
            raise Refusal(400, str(error)) from error
        except TimeoutError as error:
            raise Refusal(400, "an action must be as long as its Content-Length says") from error
        if not isinstance(found, dict):
            raise Refusal(400, "an action must be a JSON object")
        return found

    def _stream_events(self, page: str) -> None:
        if self.live.pages >= PAGES:
            raise Refusal(503, f"{PAGES} pages are open already: close one")
        self.send_response(200)
        self._send_headers({"Content-Type": "text/event-stream"})
        box = self.live.enter(page, self.headers.get("Last-Event-ID", ""))
        try:
            self.wfile.write(f"retry: {RETRY}\n\n".encode())
            while not box.closed and not self._has_left():
                self._write_events(box)
        except OSError:  # the page went away, or did not read for too long
            pass
        finally:
            self.live.leave(page, box)

    def _write_events(self, box: Box) -> None:
        """Send what waits, or a sign of life."""
        found, overrun = box.take(BEAT)
        if overrun:
            found = [*self.live.board.newest(), *(one for one in found if not one.seq)]
        self.wfile.write("".join(map(self._format_event, found)).encode() or b": here\n\n")

    def _format_event(self, one: Sent) -> str:
        name = f"id: {self.live.board.name(one)}\n" if one.seq else ""
        return f"{name}event: {one.kind}\ndata: {one.text}\n\n"

    def _has_left(self) -> bool:
        """Return whether the page has closed its connection."""
        ready, _, _ = select.select([self.connection], [], [], 0)
        return bool(ready) and self.connection.recv(1) == b""

    def _send_json(self, status: int, content: dict[str, Any]) -> None:
        self._send_bytes(status, json.dumps(content).encode(), {"Content-Type": "application/json"})

    def _send_html(self, page: str, headers: dict[str, str]) -> None:
        self._send_bytes(200, page.encode(), {"Content-Type": "text/html; charset=utf-8", **headers})

    def _send_bytes(self, status: int, content: bytes, headers: dict[str, str]) -> None:
        self.send_response(status)
        self._send_headers({"Content-Length": str(len(content)), **headers})
        if self.command != "HEAD":
            self.wfile.write(content)

    def _send_headers(self, headers: dict[str, str]) -> None:
        for name, value in {**HEADERS, **headers}.items():
            self.send_header(name, value)
        self.end_headers()
