"""An app that is served for a test, with what asks it as its page does."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from o3dls.app.desk import Desk
from o3dls.app.routes import routes_of
from o3dls.pipeline.supervision import Limits
from o3dls.web.server import LocalServer
from tests.web.asking import Asking


class Served(Asking):
    """A desk with its server."""

    command = "app"

    def __init__(self, folder: Path, limits: Limits | None = None) -> None:
        self.folder = folder
        self.desk = Desk(folder, limits)
        self.server = LocalServer(routes_of(self.desk), self.command)

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
