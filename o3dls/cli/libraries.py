"""Whether the libraries that a run needs can be imported: asked in the first second, before any work."""

from __future__ import annotations

import ctypes
import sys
from importlib.util import find_spec

from ..errors import InputError
from .doctor import MODULES, PACKAGE_OF, check_module

NEED_THE_SYSTEM = ("open3d", "pymeshlab")  # their wheels expect shared libraries of it


def check_libraries() -> None:
    """Raise InputError with the doctor's lines where a library is not there, or lacks one of the system.

    What takes seconds to import is imported only where a shared library is missing.
    """
    doubtful = [name for name in MODULES if find_spec(name) is None]
    if sys.platform == "linux" and not all(map(_is_there, PACKAGE_OF)):
        doubtful += NEED_THE_SYSTEM
    faults = [check for name in dict.fromkeys(doubtful) if not (check := check_module(name)).ok]
    if faults:
        raise InputError("; ".join(map(str, faults)))


def _is_there(library: str) -> bool:
    """Return whether the loader finds a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
