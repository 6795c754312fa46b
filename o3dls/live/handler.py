"""What a page may ask of the server, and what everything else is told.

A link with the token opens the page and leaves the token as a cookie that scripts cannot read and that no
other site's request carries. Host and Origin must be ours: a name turned to this machine gets nothing.
"""

from __future__ import annotations

import hmac
import json
import logging
import select
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit

from ..errors import O3dlsError
from .board import Board, Box, Sent
from .page import live_page
from .roles import Roles

MOST = 16_384  # bytes of an action
PAGES = 5  # a browser opens six connections to one server, and an action needs one
BEAT = 1.0  # seconds after which a silent page is sent a sign of life
RETRY = 1000  # ms after which a page that lost its connection comes back
PATIENCE = 10.0  # seconds that a page may take to ask or to read
DRAIN = 1_000_000  # bytes of a body that is too long are read, so that the page hears why it is refused
NAME = 64  # letters of a page's name, at most
HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
log = logging.getLogger("o3dls")
PATHS = {"/": "GET", "/events": "GET", "/report": "GET", "/act": "POST", "/role": "POST"}


class Refusal(Exception):
    """A refusal says why a request does not get what it asked for: status and one sentence."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


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
            log.exception("live: %s %s failed", method, urlsplit(self.path).path)
            self._send_json(500, {"error": "an error inside o3dls; its log says which"})

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer what the base class refuses: broken requests and methods without a name here."""
        self.command = self.command or ""
        self._send_json(405 if code == 501 else code, {"error": message or "no request that is understood"})

    def _route_request(self, method: str) -> None:
        asked = urlsplit(self.path)
        self._check_sender()
        given = parse_qs(asked.query)
        self._check_token(given.get("token", [""])[0] if asked.path == "/" else "")
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

    def _check_sender(self) -> None:
        """Raise Refusal where the request was meant for another server, or comes from another's page."""
        hosts = [f"{name}:{self.live.port}" for name in ("127.0.0.1", "localhost")]
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        if host not in hosts:
            raise Refusal(403, "this server answers to its own address alone")
        if origin is None and self.command != "GET":
            raise Refusal(403, "a request that changes something must say where it comes from (Origin)")
        if origin not in (None, f"http://{host}"):
            raise Refusal(403, "this server answers its own page alone")

    def _check_token(self, given: str) -> None:
        try:
            cookies = SimpleCookie(self.headers.get("Cookie", ""))
        except CookieError:
            cookies = SimpleCookie()
        kept = cookies[self._cookie_name].value if self._cookie_name in cookies else ""
        if not any(hmac.compare_digest(one.encode(), self.live.token.encode()) for one in (given, kept)):
            raise Refusal(403, "open the page by the link that o3dls live printed: it holds the token")

    @property
    def _cookie_name(self) -> str:
        """A name of its own for each port, since browsers give all ports of a machine the same cookies."""
        return f"o3dls_live_{self.live.port}"

    def _check_page_name(self, page: str) -> str:
        if not (page.isascii() and page.isalnum() and len(page) <= NAME):
            raise Refusal(400, "a page must name itself in letters and digits")
        return page

    def _send_page(self) -> None:
        cookie = f"{self._cookie_name}={self.live.token}; HttpOnly; SameSite=Strict; Path=/"
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
        if int(length) > MOST:
            self.rfile.read(min(int(length), DRAIN))
            raise Refusal(413, f"an action may have {MOST} bytes")
        try:
            found = json.loads(self.rfile.read(int(length)), parse_constant=_refuse_constant)
        except (ValueError, RecursionError, TimeoutError) as error:
            raise Refusal(400, "an action must be JSON, with finite numbers") from error
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


def _refuse_constant(text: str) -> float:
    raise ValueError(f"{text} is no finite number")
