"""A finished run in the browser: its report, opened at the pictures."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path
from threading import Thread

from ..errors import InputError
from .writer import REPORT, write_report

PICTURES = "pictures"  # the anchor of the section at which the page opens
WAIT = 10.0  # seconds; a browser that has not returned by then does so when it is closed


def page_of(folder: str | Path) -> Path:
    """Return the report of a run, and make it first where it is needed. It is report.html in the run's
    folder; where that is missing or older than the run, a new one is made in a temporary folder. Raises
    InputError where the folder holds no finished run.
    """
    from tempfile import mkdtemp

    from ..runs.folder import read_record

    folder = Path(folder)
    read_record(folder)  # raises InputError for a folder that holds a page but no run
    page = folder / REPORT
    if page.is_file() and page.stat().st_mtime >= (folder / "run.json").stat().st_mtime:
        return page.resolve()
    return write_report([folder], Path(mkdtemp(prefix="o3dls_view_")) / REPORT)


def show(page: Path, *, wait: float = WAIT) -> None:
    """Open a page in the browser, and return at once, at the latest after `wait` seconds.

    Raises InputError where there is no browser.
    """
    opener = _find_opener()
    if opener is None or not _takes_address(opener, f"{page.resolve().as_uri()}#{PICTURES}", wait):
        raise InputError(
            f"no browser could be opened here: open {page} in one, or copy it to a machine that has one; "
            "it is a single file and needs no network"
        )


def has_display() -> bool:
    """Return whether programs can show windows here."""
    named = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(named) or not sys.platform.startswith(("linux", "freebsd"))


def _find_opener() -> Callable[[str], bool] | None:
    """Find what opens an address: the browser that BROWSER names, else one with windows; never one in the
    terminal, which runs no scripts.
    """
    chosen = bool(os.environ.get("BROWSER"))
    if not chosen and not has_display():
        return None
    try:
        found = webbrowser.get()
    except webbrowser.Error:
        return None
    return found.open if chosen or type(found) is not webbrowser.GenericBrowser else None


def _takes_address(opener: Callable[[str], bool], address: str, wait: float) -> bool:
    """Return whether the browser took the address; some answer only when they are closed."""
    answers: list[bool] = []

    def ask() -> None:
        try:
            answers.append(opener(address))
        except (OSError, webbrowser.Error):
            answers.append(False)

    started = Thread(target=ask, daemon=True)
    started.start()
    started.join(wait)
    return answers[0] if answers else started.is_alive()
