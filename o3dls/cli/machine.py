"""What a run needs of the machine, asked before any work: memory, and libraries that can be imported.

Where the memory is limited to less than the libraries take, they do not say so, and OpenBLAS asks for more of
it without end.
"""

from __future__ import annotations

import ctypes
import sys
from importlib.util import find_spec

from ..errors import InputError

LEAST = 1536  # MiB of addresses: Open3D, pymeshlab, numba and scipy take 1100, and a small case 200
NEED_THE_SYSTEM = ("open3d", "pymeshlab")  # their wheels expect shared libraries of it


def check_memory() -> None:
    """Raise InputError where a limit on the addresses of this process leaves too few of them."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST << 20:
        raise InputError(
            f"the memory of this process is limited to {limit >> 20} MiB: at least {LEAST} are needed; "
            "raise the limit (ulimit -v)"
        )


def check_libraries() -> None:
    """Raise InputError with the doctor's lines where a library is not there, or lacks one of the system.

    What takes seconds to import is imported only where a shared library is missing.
    """
    from .doctor import MODULES, PACKAGE_OF, check_module

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
