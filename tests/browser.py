"""Chromium without a screen, for tests of pages; skipped with a reason where it is not installed."""

from __future__ import annotations

import atexit
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
QUIET = (
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-quic",
)
WITH_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WITHOUT_WEBGL = ("--disable-gpu", "--disable-3d-apis", "--disable-software-rasterizer")


@contextmanager
def chromium() -> Iterator[Callable[..., Any]]:
    """A function that gives a browser, with or without WebGL, which a process starts once; what was opened in
    it is closed at the end.
    """
    given = []

    def launch(*, webgl: bool = True) -> Any:
        given.append(_browser(webgl))
        return given[-1]

    _driver()
    yield launch
    for browser in given:
        for context in browser.contexts:
            context.close()


@cache
def _driver() -> Any:
    """Playwright, until the process ends."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed: pages are not tested"
    )
    if why := _broken_driver():
        pytest.skip(f"Playwright's driver does not start: pages are not tested: {why}")
    started = playwright.sync_playwright().start()
    atexit.register(started.stop)  # and with it every browser
    return started


@cache
def _browser(webgl: bool) -> Any:
    from playwright.sync_api import Error

    chromium = _driver().chromium
    own = chromium.executable_path
    path = next(filter(None, map(shutil.which, NAMES)), own if Path(own).is_file() else None)
    if path is None:
        pytest.skip("no Chromium: pages are not tested")
    args = [*QUIET, *(WITH_WEBGL if webgl else WITHOUT_WEBGL)]
    try:
        return chromium.launch(executable_path=path, args=args)
    except Error as error:
        pytest.skip(f"{path} does not start: pages are not tested: {error.message.splitlines()[0]}")


@cache
def _broken_driver() -> str:
    """Why Playwright's own node does not start, as where a library of the system is missing; else empty.

    Asked in a process of its own: a driver that dies under us leaves an event loop behind.
    """
    asked = subprocess.run(
        [sys.executable, "-m", "playwright", "--version"], capture_output=True, text=True, check=False
    )
    said = (asked.stderr or asked.stdout).strip().splitlines() or [f"exit code {asked.returncode}"]
    return said[-1] if asked.returncode else ""


class Visit:
    """A page, opened from a file or an address, with what went wrong and what it asked of the network."""

    def __init__(
        self,
        browser: Any,
        path: Path | str,
        *,
        width: int = 1440,
        height: int = 900,
        wait: bool = True,
        **options: Any,
    ) -> None:
        self.page = browser.new_page(viewport={"width": width, "height": height}, **options)
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on(
            "console",
            lambda message: (
                self.errors.append(message.text) if message.type in ("error", "warning") else None
            ),
        )
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path if isinstance(path, str) else path.resolve().as_uri())
        if wait:
            self.page.wait_for_function(
                "() => document.documentElement.dataset.ready !== undefined", timeout=60_000
            )

    def picture(self, index: int) -> Any:
        """Pixels (height, width, 4) of a panel's canvas."""
        import numpy as np

        found = self.page.evaluate(
            """index => {
                const canvas = document.querySelectorAll('#panels canvas')[index];
                const picture = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
                const { data, width, height } = picture;
                let text = '';
                for (let i = 0; i < data.length; i += 8192)
                    text += String.fromCharCode(...data.subarray(i, i + 8192));
                return { text: btoa(text), width, height };
            }""",
            index,
        )
        import base64

        return (
            np.frombuffer(base64.b64decode(found["text"]), dtype=np.uint8)
            .reshape(found["height"], found["width"], 4)
            .astype(int)
        )

    def settle(self) -> None:
        """Let the page paint what was asked for."""
        self.page.evaluate(
            "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )


def violations(visit: Visit) -> list[str]:
    """What axe-core finds wrong on the page as it stands: rule, help and the element; skipped with a reason
    where axe is not installed.
    """
    axe = pytest.importorskip(
        "axe_playwright_python.sync_playwright",
        reason="axe-playwright-python is not installed: accessibility is not tested",
    )
    found = axe.Axe().run(visit.page).response["violations"]
    return [f"{one['id']}: {one['help']}: {node['html']}" for one in found for node in one["nodes"]]
