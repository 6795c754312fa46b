"""An app that is served for a test, with what asks it as its page does."""

from __future__ import annotations

import http.client
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from o3dls.app.desk import Desk
from o3dls.app.routes import most_bytes, routes_of
from o3dls.pipeline.supervision import Limits
from o3dls.web.server import LocalServer


class Served:
    """A desk with its server."""

    def __init__(self, folder: Path, limits: Limits | None = None) -> None:
        self.folder = folder
        self.desk = Desk(folder, limits)
        self.server = LocalServer(routes_of(self.desk), "app", most_bytes)

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.server.port}"

    def headers(self) -> dict[str, str]:
        """The headers that a page of ours sends."""
        cookie = f"o3dls_app_{self.server.port}={self.server.token}"
        return {
            "Host": self.host,
            "Cookie": cookie,
            "Origin": f"http://{self.host}",
            "Content-Type": "application/json",
        }

    def ask(self, method: str, path: str, body: Any = None, **headers: str | None) -> tuple[int, str, Any]:
        """Status, text and headers of an answer; the headers are those of our page but for what is given."""
        given = self.headers() | {key.replace("_", "-"): value for key, value in headers.items()}
        connection = http.client.HTTPConnection(self.host, timeout=60)
        text = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        connection.request(method, path, text, {k: v for k, v in given.items() if v is not None})
        answer = connection.getresponse()
        found = answer.status, answer.read().decode("utf-8", "replace"), dict(answer.getheaders())
        connection.close()
        return found

    def act(self, path: str, content: dict[str, Any]) -> dict[str, Any]:
        """What an action gives."""
        return dict(json.loads(self.ask("POST", path, content)[1]))

    def put(self, name: str, content: bytes) -> dict[str, Any]:
        """What bringing a file gives."""
        return dict(json.loads(self.ask("PUT", f"/files/{name}", content)[1]))

    def close(self) -> None:
        self.server.close()
        self.desk.close()


@contextmanager
def served(folder: Path, limits: Limits | None = None) -> Iterator[Served]:
    """An app on a folder, while the block runs."""
    folder.mkdir(exist_ok=True)
    made = Served(folder, limits)
    try:
        yield made
    finally:
        made.close()


def ask_as_page(url: str) -> tuple[str, dict[str, str]]:
    """The host of a link, and the headers of its page."""
    found = re.fullmatch(r"http://(127.0.0.1:(\d+))/\?token=(.*)", url)
    assert found
    host, port, token = found.groups()
    cookie = f"o3dls_app_{port}={token}"
    return host, {"Cookie": cookie, "Origin": f"http://{host}", "Content-Type": "application/json"}
