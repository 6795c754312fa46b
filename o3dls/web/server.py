"""A server of pages for this machine alone, in a thread of its own."""

from __future__ import annotations

import secrets
import socket
from asyncio import TimerHandle, Transport
from contextlib import suppress
from threading import Thread
from typing import Any, cast

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from ..errors import InputError
from .guard import Guard
from .roles import Roles
from .routes import Routes, router_of
from .rules import NAMES, PATIENCE

BACKLOG = 512  # connections that wait
HEAD = 32_768  # bytes that the head of a request may have
GRACE = 1  # seconds in which pages that are being answered may be, at the end


class _Protocol(H11Protocol):
    """This protocol ends a connection on which nothing is asked for, however slowly it begins to be, or on
    which the answer is not read.
    """

    _patience: TimerHandle | None = None
    _reading: TimerHandle | None = None

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._patience = self.loop.call_later(PATIENCE, self._close_silent)

    def connection_lost(self, exc: Exception | None) -> None:
        for timer in (self._patience, self._reading):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        super().pause_writing()
        self._reading = self.loop.call_later(PATIENCE, self.transport.abort)

    def resume_writing(self) -> None:
        if self._reading is not None:
            self._reading.cancel()
        super().resume_writing()

    def _close_silent(self) -> None:
        if cast(Any, self).cycle is None:  # its type leaves out that no request may have come
            self.transport.close()


class LocalServer:
    """This server answers routes, behind the guard and each by its rule, from when it is made until `close`.

    command: the command that serves, which refusals name; roles: which page acts, where a rule asks for it.
    Raises InputError where the port is taken.
    """

    def __init__(self, routes: Routes, command: str, port: int = 0, roles: Roles | None = None) -> None:
        self._socket = _listen(port)
        self.port = int(self._socket.getsockname()[1])
        self.token = secrets.token_urlsafe(24)
        guarded = Guard(router_of(routes, roles or Roles()), command, self.port, self.token)
        settings: dict[str, Any] = {
            "http": _Protocol,
            "ws": "none",
            "loop": "asyncio",
            "lifespan": "off",
            "log_config": None,
            "log_level": "critical",
            "access_log": False,  # the link holds the token
            "proxy_headers": False,
            "server_header": False,
            "h11_max_incomplete_event_size": HEAD,
            "timeout_graceful_shutdown": GRACE,
        }
        self._server = uvicorn.Server(uvicorn.Config(guarded, **settings))
        self._thread = Thread(target=self._server.run, args=([self._socket],), daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The link to the page, with the token without which nothing is answered."""
        return f"http://{NAMES[0]}:{self.port}/?token={self.token}"

    def close(self) -> None:
        """Let every page go and stop. A second time does nothing."""
        self._server.should_exit = True
        self._thread.join(PATIENCE)
        with suppress(OSError):
            self._socket.close()


def _listen(port: int) -> socket.socket:
    """Open the port, on the address of this machine alone."""
    opened = socket.socket()
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((NAMES[0], port))
        opened.listen(BACKLOG)  # from now on, who asks waits until the server answers
    except (OSError, OverflowError) as error:
        opened.close()
        raise InputError(f"port = {port}: cannot be listened on: {error}") from error
    return opened
