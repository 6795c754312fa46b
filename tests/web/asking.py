"""What asks a server of ours as its page does, or as somebody else would."""

from __future__ import annotations

import http.client
import json
import socket
import time
from collections.abc import Callable
from typing import Any, Protocol


class Server(Protocol):
    """What is asked."""

    port: int
    token: str


class Asking:
    """Asks the server of a command."""

    command: str
    server: Server

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.server.port}"

    @property
    def cookie(self) -> str:
        return f"o3dls_{self.command}_{self.server.port}={self.server.token}"

    def headers(self) -> dict[str, str]:
        """The headers that a page of ours sends."""
        return {
            "Host": self.host,
            "Cookie": self.cookie,
            "Origin": f"http://{self.host}",
            "Content-Type": "application/json",
            "X-Page": "a",
        }

    def ask(self, method: str, path: str, body: Any = None, **headers: str | None) -> tuple[int, str, Any]:
        """Status, text and headers of an answer; the headers are those of our page but for what is given."""
        given = self.headers() | {key.replace("_", "-"): value for key, value in headers.items()}
        connection = http.client.HTTPConnection(self.host, timeout=60)
        text = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        connection.request(method, path, text, {k: v for k, v in given.items() if v is not None})
        answer = connection.getresponse()
        endless = answer.getheader("content-type", "").startswith("text/event-stream")
        text = "" if endless else answer.read().decode("utf-8", "replace")
        found = answer.status, text, {key.lower(): value for key, value in answer.getheaders()}
        answer.close()
        connection.close()
        return found

    def begin(self, method: str, path: str, more: str = "") -> socket.socket:
        """A connection on which a request was begun; `more` is what follows the headers of our page."""
        connection = socket.create_connection(("127.0.0.1", self.server.port), timeout=10.0)
        lines = [f"{method} {path} HTTP/1.1", *(f"{key}: {value}" for key, value in self.headers().items())]
        connection.sendall("\r\n".join([*lines, more]).encode())
        return connection


def until(reached: Callable[[], object], seconds: float = 10.0) -> None:
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end
        time.sleep(0.02)
