"""Child processes begin without the working folder in Python's path: a file there that is named like a module
would be run in that module's place, and the folder may be anybody's.
"""

from __future__ import annotations

import os
from multiprocessing import get_context
from multiprocessing.context import SpawnContext

SAFE_PATH = "PYTHONSAFEPATH"  # every Python that is begun from here on obeys it, whoever begins it


def protect_path() -> None:
    """Keep the working folder out of the path of every Python that this process begins from now on."""
    os.environ[SAFE_PATH] = "1"


def spawn_context() -> SpawnContext:
    """Return what begins processes of our own, with a safe path. A fork would hang once numba has used its
    threads.
    """
    protect_path()
    return get_context("spawn")
