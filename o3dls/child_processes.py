"""Child processes begin without the working folder in Python's path: a file there that is named like a module
would be run in that module's place, and the folder may be anybody's.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from threading import Lock

SAFE_PATH = "PYTHONSAFEPATH"  # every Python that is begun while it is set obeys it, whoever begins it


class _SafePath:
    """This has the count of those who begin processes: the last thread restores what the first has found."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.users = 0
        self.before: str | None = None

    def enter(self) -> None:
        with self.lock:
            if self.users == 0:
                self.before = os.environ.get(SAFE_PATH)
            self.users += 1
            os.environ[SAFE_PATH] = "1"

    def leave(self) -> None:
        with self.lock:
            self.users -= 1
            if self.users:
                return
            if self.before is None:
                del os.environ[SAFE_PATH]
            else:
                os.environ[SAFE_PATH] = self.before


_safe = _SafePath()


@contextmanager
def safe_path() -> Iterator[None]:
    """Keep the working folder out of the path of every Python that is begun within this, by any thread."""
    _safe.enter()
    try:
        yield
    finally:
        _safe.leave()


def protect_path() -> None:
    """Do the same for as long as this process lives, which must be one of ours alone."""
    os.environ[SAFE_PATH] = "1"


@contextmanager
def kept_environment(names: Iterable[str]) -> Iterator[None]:
    """Restore these variables at the end: a library may set them in this process for those that it begins."""
    before = {name: os.environ.get(name) for name in names}
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
