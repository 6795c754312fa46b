"""A file that was brought, once it is whole: it gets its name, or is one that is there already."""

from __future__ import annotations

import filecmp
import os
from pathlib import Path
from threading import Lock

from .shelf import FILES, Shelf, named

NAMING = Lock()  # two files of one name that come at one time get two names


def keep_file(staged: Path, shelf: Shelf, name: str) -> str:
    """Give a file that has come whole its name in the folder; its path. The same file is kept once."""
    there = shelf.folder / FILES / named(name)
    if there.is_file() and not there.is_symlink() and filecmp.cmp(there, staged, shallow=False):
        return there.relative_to(shelf.folder).as_posix()
    with staged.open("rb+") as file:
        os.fsync(file.fileno())
    with NAMING:
        path = shelf.new_file(name)
        os.replace(staged, path)
    return path.relative_to(shelf.folder).as_posix()
