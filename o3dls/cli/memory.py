"""The memory that a process may use: where it is limited to less than the libraries take, they do not say so,
and OpenBLAS asks for more of it without end.
"""

from __future__ import annotations

from ..errors import InputError

LEAST = 1536  # MiB of addresses: Open3D, pymeshlab, numba and scipy take 1100, and a small case 200


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
