"""A live session of a case: the command `o3dls live`, in a process of its own with a page of its own. What it
takes is in its record folder, from where the command goes on with it.
"""

from __future__ import annotations

import subprocess
import sys
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from threading import Event, Lock, Thread

from ..child_processes import safe_path
from ..errors import InputError
from ..pipeline.workers import GRACE
from ..report.markup import Html, tag
from .bring import command
from .parts import own_asset
from .shelf import Shelf
from .worker import Message

SESSIONS = "live"  # the folder of records
SOURCES = ("watch", "igtl")  # options of the command that say where points come from
PATIENCE = 120.0  # seconds in which the command has said its link, on a machine that has much to do
MOST_LINES = 20  # of what it says, the newest


class Sessions:
    """This class holds the one session that an app may have open. Safe to use from several threads."""

    def __init__(self, shelf: Shelf) -> None:
        self._shelf, self._lock = shelf, Lock()
        self._session: _Session | None = None

    def begin(self, case: Path, source: str, place: str) -> Message:
        """Begin a session of a case, or find the one that is open: the link to its page, its record, and the
        command that does the same.

        source: watch, at a place in the folder of the app, or igtl, at HOST:PORT. Raises InputError where
        another case has a session, or the command refuses.
        """
        if source not in SOURCES:
            raise InputError(f"source = {source!r}: must be one of {', '.join(SOURCES)}")
        if source == "watch":
            place = self._shelf.place(place).as_posix()
        with self._lock:
            found = self._session
            if found is None or not found.open:
                record = self._shelf.new_folder(SESSIONS, case.name).as_posix()
                options = {source: place, "record": record}
                found = self._session = _Session(self._shelf.folder, case, options)
        if found.case != case:
            raise InputError(f"{found.case}: a live session of it is open; end it on its page first")
        line = command("live", [case], found.options)
        return {"link": found.wait_for_link(), "record": found.options["record"], "command": line}

    def close(self) -> None:
        """End the process of the session; its record stays."""
        if self._session:
            self._session.end()


def live_section() -> Html:
    """Write what begins a live session on the page of a case."""
    return tag("section", tag("h2", "Or take points live"), Html(own_asset("live.html")), id="live")


class _Session:
    """This class is the command at work. It is followed until it ends."""

    def __init__(self, folder: Path, case: Path, options: Mapping[str, str]) -> None:
        self.case, self.options = case, options
        self._link, self._lines = "", deque[str](maxlen=MOST_LINES)
        self._told = Event()
        given = [f"--{name}={value}" for name, value in options.items()]
        with safe_path():
            self._process = subprocess.Popen(
                [sys.executable, "-m", "o3dls", "live", "--no-browser", *given, "--", str(case)],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
        Thread(target=self._follow_lines, daemon=True).start()

    @property
    def open(self) -> bool:
        """Whether the command is at work."""
        return self._process.poll() is None

    def wait_for_link(self) -> str:
        """Return the link to the page. Raises InputError where the command ends without one."""
        self._told.wait(PATIENCE)
        if not self._link:
            self.end()
            raise InputError((self._lines or ["the live session did not begin; try again"])[-1])
        return self._link

    def end(self) -> None:
        """End the command, first as told to and then at once."""
        for end in (self._process.terminate, self._process.kill):
            end()
            try:
                self._process.wait(GRACE)
                return
            except subprocess.TimeoutExpired:
                pass

    def _follow_lines(self) -> None:
        """Read what the command says, so that it never waits to say it."""
        stream = self._process.stderr
        assert stream is not None
        with stream:
            for line in stream:
                if line.startswith("http://"):
                    self._link = line.strip()
                    self._told.set()
                else:
                    self._lines.append(line.strip().removeprefix("o3dls: "))
        self._told.set()
        self._process.wait()
