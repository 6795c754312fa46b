"""Compiled loops: over rows on several cores, each thread filling rows of its own, so that results do not
depend on how many there are; and a word where they have to be compiled first.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import lru_cache
from itertools import pairwise
from threading import Lock, Thread
from typing import Any, TypeVar

import numpy as np
from numba import config
from numba.core.event import Event, Listener, install_listener
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from .arrays import Array

# the cores this process may use, unless the variable of that name says otherwise
THREADS: int = config.NUMBA_NUM_THREADS
QUERIES = 4000  # of a KD-tree: so many take longer than waking a thread
PARTS = 3  # blocks of rows per thread: some take longer than others

log = logging.getLogger("o3dls")
A = TypeVar("A")
B = TypeVar("B")


def axes_of(vectors: Array) -> tuple[int, ...]:
    """Return a tuple as long as vectors (n, d) have axes: the compiler knows how long a tuple is, and unrolls
    the loops of a kernel over it.
    """
    return (0,) * int(vectors.shape[1])


def by_rows(kernel: Callable[..., Any], least: int, rows: tuple[NDArray[Any], ...], *shared: Any) -> None:
    """Call kernel(*rows, *shared), which reads and fills `rows` (arrays of equal length) one by one and lets
    go of the interpreter's lock, on as many threads as have `least` rows to do: fewer take less time than to
    wake a thread.
    """
    count = len(rows[0])
    threads = min(THREADS, count // least)
    if threads < 2:
        kernel(*rows, *shared)
        return
    bounds = np.linspace(0, count, min(PARTS * threads, count // least) + 1).astype(int)
    # shared by the threads: a list iterator hands out each part only once
    left = iter([tuple(row[a:b] for row in rows) for a, b in pairwise(bounds)])

    def work() -> None:
        for part in left:
            kernel(*part, *shared)

    begun = [_thread_pool(os.getpid()).submit(work) for _ in range(threads - 1)]
    work()
    for thread in begun:
        if not thread.cancel():  # a thread that was busy elsewhere has not begun, and nothing is left to do
            thread.result()


def threads_for(queries: int) -> int:
    """Return how many threads so many queries of a KD-tree are worth."""
    return THREADS if queries > QUERIES else 1


def limit_threads(processes: int) -> None:
    """Leave this process its part of the cores, of so many processes that work at one time."""
    global THREADS
    THREADS = max(1, config.NUMBA_NUM_THREADS // processes)


@lru_cache
def _thread_pool(process: int) -> ThreadPoolExecutor:
    """Return the threads of a process: a fork has none of its parent's."""
    return ThreadPoolExecutor(THREADS - 1)


def started_beside(work: Callable[[], None]) -> None:
    """Start work on a thread that nobody waits for; what fails in it fails again where it is needed."""

    def quiet() -> None:
        with suppress(Exception):
            work()

    Thread(target=quiet).start()


def both(first: Callable[[], A], second: Callable[[], B]) -> tuple[A, B]:
    """Return what two independent functions return, which run side by side: compiled loops and linear algebra
    let go of the interpreter's lock. Linear algebra has one thread in each.
    """
    with one_blas_thread(), ThreadPoolExecutor(1) as beside:
        begun = beside.submit(second)
        return first(), begun.result()


def each(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Return what a function returns for each of some independent items, on as many threads as cores; see
    `both`.
    """
    with one_blas_thread(), ThreadPoolExecutor(THREADS) as threads:
        return list(threads.map(function, items))


def once(function: Callable[[], A]) -> Callable[[], A]:
    """Return a function that calls another one the first time, and returns the same value ever after; threads
    that ask meanwhile wait for it.
    """
    lock, known = Lock(), list[A]()

    def value() -> A:
        with lock:
            if not known:
                known.append(function())
        return known[0]

    return value


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within this, linear algebra has one thread: on matrices of a few hundred rows two take three times as
    long, and on a busy machine they wait for each other without end.
    """
    with _blas_controller().limit(limits=1, user_api="blas"):
        yield


@lru_cache
def _blas_controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def compiling_said() -> Iterator[None]:
    """Within this, the first loop that has to be compiled is announced: a version's first run seems to stand
    still.
    """
    with install_listener("numba:compile", _Compiling()):
        yield


class _Compiling(Listener):  # type: ignore[misc]
    said = False

    def on_start(self, event: Event) -> None:
        if not self.said:
            log.info("compiling the loops of this version, which is done once and takes up to a minute")
        self.said = True

    def on_end(self, event: Event) -> None:
        pass
