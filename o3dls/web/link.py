"""How a browser is led to a page without the token being seen by others."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def led_to(url: str, folder: Path, name: str = "page.html") -> Iterator[Path]:
    """Yield a file that leads a browser to a page, and is there while the block runs. Only this user can read
    it: the link holds the token, and what a program is started with is seen by all users of the machine.
    """
    path = folder.resolve() / name
    path.unlink(missing_ok=True)  # of a session that was killed
    number = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
    try:
        with open(number, "w", encoding="utf-8") as file:
            file.write(f'<!doctype html><meta http-equiv="refresh" content="0; url={url}">\n')
        yield path
    finally:
        path.unlink(missing_ok=True)
