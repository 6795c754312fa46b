"""Compiled loops over rows on several cores: each thread fills rows of its own, so that results do not depend on how many there are."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numba import config

from ..geometry import Array, Ints

THREADS: int = config.NUMBA_NUM_THREADS  # the cores this process may use, unless the variable of that name says otherwise


def by_rows(kernel: Callable[..., Any], least: int, rows: tuple[Array | Ints, ...], *shared: Any) -> None:
    """Call kernel(*rows, *shared), which reads and fills `rows` (arrays of equal length) one by one and lets go of the interpreter's lock,
    on as many threads as have `least` rows to do: fewer take less time than to wake a thread."""
    count = len(rows[0])
    bounds = np.linspace(0, count, max(1, min(THREADS, count // least)) + 1).astype(int)
    mine, *others = (tuple(row[a:b] for row in rows) for a, b in pairwise(bounds))
    pool = _pool(os.getpid()) if others else None
    begun = [pool.submit(kernel, *part, *shared) for part in others] if pool else []
    kernel(*mine, *shared)
    for part in begun:
        part.result()


def share(processes: int) -> None:
    """Leave this process its part of the cores, of so many processes that work at one time."""
    global THREADS
    THREADS = max(1, config.NUMBA_NUM_THREADS // processes)


@lru_cache
def _pool(process: int) -> ThreadPoolExecutor:
    """Threads of a process: a fork has none of its parent's."""
    return ThreadPoolExecutor(THREADS - 1)
