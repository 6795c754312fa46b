"""An app in the browser, as tests of its pages open it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.app.served import Served, served
from tests.browser import Visit


@pytest.fixture
def app(tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path / "work") as made:
        yield made


@pytest.fixture
def visit(browser: Any, app: Served) -> Iterator[Visit]:
    opened = Visit(browser, app.server.url, wait=False)
    yield opened
    # the first is said of these tests, the second of what the server asks about
    known = ("willReadFrequently", "status of 422")
    assert [text for text in opened.errors if not any(one in text for one in known)] == []
    own = f"http://{app.host}/"
    assert [url for url in opened.requests if not url.startswith((own, "blob:", "data:"))] == []
    opened.page.close()


FIXTURES = app, visit
