"""The guard stands before every route of a server: it asks who sends a request, bounds how long its body may
take, and says why it is refused.
"""

from __future__ import annotations

import asyncio
import json
import logging
from contextlib import suppress
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..errors import Doubt, O3dlsError
from .rules import HEADERS, PATIENCE, Refusal, check_sender, check_token, cookie_line

DRAIN, HEARD = 1_000_000, 1.0  # bytes of a refused body that are read, and seconds in which they come
HOME = "/"  # the path that the link with the token opens
log = logging.getLogger("o3dls")


class Guard:
    """This class answers what the rules refuse, and passes the rest on.

    command: what printed the link, such as `app`.
    """

    def __init__(self, app: ASGIApp, command: str, port: int, token: str) -> None:
        self._app, self._command, self._port, self._token = app, command, port, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return  # websockets and the like are not spoken here
        answered, body = _Answered(send), _Body(receive)
        try:
            answered.cookie = self._check_request(scope)
            await self._app(scope, body, answered)
        except Refusal as refusal:
            await body.drain()
            await answered.refuse(refusal.status, {"error": str(refusal)})
        except Doubt as doubt:
            asked = {"doubt": doubt.record()} if doubt.answers else {}  # nobody can be asked without answers
            await answered.refuse(422, {"error": str(doubt), **asked})
        except O3dlsError as error:
            await answered.refuse(422, {"error": str(error)})
        except (ConnectionError, ClientDisconnect, asyncio.CancelledError):
            raise  # the page went away, or the server ends
        except Exception:  # the page must hear that its action failed
            log.exception("%s: %s failed", self._command, scope["path"])
            await answered.refuse(500, {"error": "an error inside o3dls; its log says which"})

    def _check_request(self, scope: Scope) -> str | None:
        """Return the cookie that the answer leaves, on the home page alone. Raises Refusal."""
        headers, method = Headers(scope=scope), scope["method"]
        check_sender(self._port, method, headers.get("host", ""), headers.get("origin"))
        home = scope["path"] == HOME and method == "GET"
        given = parse_qs(scope["query_string"].decode("ascii", "replace")).get("token", [""])[0]
        check_token(self._command, self._port, self._token, given if home else "", headers.get("cookie", ""))
        return cookie_line(self._command, self._port, self._token) if home else None


class _Body:
    """This is the way of a body here, in pieces of which each must come within its time."""

    def __init__(self, receive: Receive) -> None:
        self._receive, self._done = receive, False

    async def __call__(self) -> Message:
        if self._done:
            return await self._receive()  # waits for the page to go away
        try:
            async with asyncio.timeout(PATIENCE):
                piece = await self._receive()
        except TimeoutError:
            raise Refusal(408, "a body must be as long as its Content-Length says") from None
        self._done = not piece.get("more_body", False)
        return piece

    async def drain(self) -> None:
        """Read a part of what is not wanted: a page hears why it is refused once it has been heard."""
        left = DRAIN
        with suppress(TimeoutError, Refusal):
            async with asyncio.timeout(HEARD):
                while left > 0 and not self._done:
                    left -= len((await self()).get("body", b""))


class _Answered:
    """This is the way of an answer back, on which it gets the headers that all answers have.

    Every connection carries one request: who is slow with a second one holds nothing.
    """

    def __init__(self, send: Send) -> None:
        self._send, self._begun = send, False
        self.cookie: str | None = None

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self._begun = True
            known = {name.lower() for name, _ in message["headers"]}
            more = {**HEADERS, "Connection": "close"} | ({"Set-Cookie": self.cookie} if self.cookie else {})
            added = [(k.lower().encode(), v.encode()) for k, v in more.items()]
            message["headers"] = [*message["headers"], *(one for one in added if one[0] not in known)]
        await self._send(message)

    async def refuse(self, status: int, content: dict[str, object]) -> None:
        """Answer why nothing is answered; where an answer has begun already, nothing can be said any more."""
        if self._begun:
            return
        body = json.dumps(content).encode()
        headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
        await self({"type": "http.response.start", "status": status, "headers": headers})
        await self._send({"type": "http.response.body", "body": body})
