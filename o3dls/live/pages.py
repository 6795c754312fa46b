"""The pages of a session: what they are told, which of them acts, and what it does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from time import monotonic, sleep
from typing import Any

from ..web.roles import Roles
from .board import Board, Box, Sent

ANEW = 2.0  # seconds in which a page that loads anew is back
LOOK = 0.1  # seconds between two looks at whether pages are open
Act = Callable[[dict[str, Any]], dict[str, Any]]


class Pages:
    """This class holds the pages that show one session. Safe to use from several threads.

    act(action) gives {"ok": true, ...}, or {"error": text} for what was refused; it is called from several
    threads, one at a time.
    """

    def __init__(self, act: Act) -> None:
        self.board, self.roles = Board(), Roles()
        self._act, self._acting = act, Lock()
        self._boxes: dict[int, tuple[Box, str]] = {}
        self._lock = Lock()

    @property
    def number(self) -> int:
        """How many pages are connected."""
        return len(self._boxes)

    def act(self, action: dict[str, Any]) -> dict[str, Any]:
        """Do an action of the page that acts, and return what comes of it."""
        with self._acting:
            return self._act(action)

    @contextmanager
    def connected(self, page: str, last: str) -> Iterator[Box]:
        """Yield the box of a page that is connected while the block runs, and has seen the event `last`."""
        box = self.board.join(last)
        self.roles.enter(page)
        with self._lock:
            self._boxes[id(box)] = (box, page)
        self._tell_roles()
        try:
            yield box
        finally:
            self.board.leave(box)
            with self._lock:
                self._boxes.pop(id(box), None)
            self.roles.leave(page)
            self._tell_roles()

    def take_box(self, box: Box, seconds: float) -> list[Sent]:
        """Take what waits for a page, after at most so many seconds; the newest of everything where more was
        told than it could read.
        """
        found, overrun = box.take(seconds)
        return [*self.board.newest(), *(one for one in found if not one.seq)] if overrun else found

    def ask_role(self, page: str) -> bool:
        """Ask for the role that acts, and return whether the page has it now."""
        granted = self.roles.ask(page)
        self._tell_roles()
        return granted

    def wait(self) -> None:
        """Return once no page is open any more: after the end of a session, so that its report can be read. A
        page that loads anew is not gone.
        """
        gone = monotonic() - (0.0 if self.number else ANEW)
        while self.number or monotonic() - gone < ANEW:
            gone = monotonic() if self.number else gone
            sleep(LOOK)

    def close(self) -> None:
        """Let every page go."""
        for box, _ in self._list_boxes():
            box.close()

    def _tell_roles(self) -> None:
        """Say to every page whether it acts, and whether it may ask to."""
        for box, page in self._list_boxes():
            acts = str(self.roles.acts(page)).lower()
            free = str(self.roles.free()).lower()
            box.put(Sent(0, "role", f'{{"event":"role","acts":{acts},"free":{free}}}'))

    def _list_boxes(self) -> list[tuple[Box, str]]:
        with self._lock:
            return list(self._boxes.values())
