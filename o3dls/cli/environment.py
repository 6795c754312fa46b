"""What a command finds around it: streams that are closed, variables and files that libraries obey. It is
mended or refused before any work, since a library that cannot use it says so only when the work is done.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Mapping
from importlib import import_module
from importlib.util import LazyLoader, find_spec, module_from_spec

from ..errors import InputError

LEAST = 1536  # MiB of addresses: Open3D, pymeshlab, numba and scipy take 1100, and a small case 200
NEED_THE_SYSTEM = ("open3d", "pymeshlab")  # their wheels expect shared libraries of it
NUMBA_FILE = (
    ".numba_config.yaml"  # numba obeys it in the working folder, and runs what is in a folder it names
)
# read before numpy begins: our systems are small, and threads made them ten times slower
USUAL = {"OPENBLAS_NUM_THREADS": "1"}
# pictures are drawn without a window, and look the same in every folder and home
FIXED = {"MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull}
WHOLE = {"NUMBA_NUM_THREADS": 1, "SOURCE_DATE_EPOCH": 0}  # the least of each
MOST_DIGITS = 10
# scipy lists all of numpy, and so runs these: a tenth of the time that imports take
LISTED = ("numpy.f2py", "numpy.testing")


def open_streams() -> None:
    """Give every standard stream that is closed a place to go: Python has None for it, and the next file that
    is opened would take its number and be written into by libraries.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            # the lowest number that is free, which is this one
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))


def settle_variables() -> None:
    """Set the variables by which libraries would do otherwise than we need."""
    for name, value in USUAL.items():
        os.environ.setdefault(name, value)
    os.environ.update(FIXED)


def delay_unused() -> None:
    """Let modules that libraries import and never use run at their first use; those that have run stay."""
    for name in LISTED:
        spec = None if name in sys.modules else find_spec(name)
        if spec is None or spec.loader is None:
            continue
        spec.loader = LazyLoader(spec.loader)
        module = sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(module)
        package, _, child = name.rpartition(".")
        setattr(import_module(package), child, module)


def check_environment(variables: Mapping[str, str] = os.environ) -> None:
    """Raise InputError for what a library would stumble over, or obey though nobody asked for it."""
    for name, least in WHOLE.items():
        given = variables.get(name, str(least))
        digits = given.strip()
        if (
            not (digits.isascii() and digits.isdecimal() and len(digits) <= MOST_DIGITS)
            or int(digits) < least
        ):
            raise InputError(f"{name} = '{given}': must be a whole number of at least {least}; or unset it")
    if os.path.lexists(NUMBA_FILE):
        raise InputError(
            f"{os.path.abspath(NUMBA_FILE)}: numba would obey this file, which can make it run code; "
            "move it away, or work in another folder"
        )


def check_memory() -> None:
    """Raise InputError where a limit on the addresses of this process leaves too few of them: the libraries
    do not say so, and OpenBLAS asks for more of them without end.
    """
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
