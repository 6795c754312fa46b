"""Child processes begin without the working folder in Python's path: a file there that is named like a module
would be run in that module's place, and the folder may be anybody's.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

SAFE_PATH = "PYTHONSAFEPATH"  # every Python that is begun while it is set obeys it, whoever begins it


@contextmanager
def safe_path() -> Iterator[None]:
    """Keep the working folder out of the path of every Python that is begun within this."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


def protect_path() -> None:
    """Do the same for as long as this process lives, which must be one of ours alone."""
    os.environ[SAFE_PATH] = "1"
