"""Processes for tasks side by side: they share the cores, and end with the one that asked for them."""

from __future__ import annotations

import logging
import os
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from threading import Thread
from typing import Any

from .. import parallel
from ..child_processes import safe_path
from ..errors import InputError

GRACE = 2.0  # seconds in which a process that was told to end may remove what it has half made
BEGUN = 10.0  # seconds in which a process has begun, also where others keep the cores busy
log = logging.getLogger("o3dls")


@contextmanager
def workers(processes: int, beside: int = 0) -> Iterator[Executor]:
    """Yield a pool of so many processes; what interrupts the block drops the tasks that wait and ends those
    that run.

    beside: how many processes of other pools share the cores with these. Raises InputError where the system
    lets none begin.
    """
    spawn = get_context("spawn")  # fork hangs once numba has used its threads
    theirs, ours = spawn.Pipe(duplex=False)
    with ours, theirs, _open_pool(processes, spawn, (processes + beside, theirs)) as pool:
        results = pool._result_queue  # kept, since a pool that is shut down forgets it
        try:
            with _report_no_process(), _block_interrupts(), safe_path():
                for _ in range(processes):
                    pool.submit(int)  # begins a process
            yield pool
        except BaseException:
            follower = pool._executor_manager_thread
            pool.shutdown(wait=False, cancel_futures=True)
            ours.close()
            # a process that is ended while it sends leaves half a result; with our end closed, none waits
            results._writer.close()  # type: ignore[attr-defined]
            # one that is just beginning would not find the semaphores of a parent that has gone before it
            if follower is not None:
                follower.join(BEGUN + GRACE)  # type: ignore[attr-defined]  # of another class in typeshed
            raise


def _open_pool(processes: int, spawn: SpawnContext, given: tuple[int, Connection]) -> ProcessPoolExecutor:
    with _report_no_process(), safe_path():  # semaphores have a process of Python that looks after them
        return ProcessPoolExecutor(processes, spawn, initializer=begin_process, initargs=given)


@contextmanager
def _report_no_process() -> Iterator[None]:
    """Raise InputError for what keeps the system from beginning a process."""
    try:
        yield
    except (OSError, ImportError) as error:  # ImportError: Python was built without semaphores
        raise InputError(
            f"no further process can be begun ({error}): are there too many? They need "
            "semaphores, on Linux in a /dev/shm that this user may write to"
        ) from None


@contextmanager
def second_process(folds: int) -> Iterator[Executor | None]:
    """Yield a process beside this one for the folds of a cross-validation, which begins at once, as it has
    much to import; None where there are no folds, or no core for it, or the system lets none begin.
    """
    with ExitStack() as open_:
        pool = None
        if folds and parallel.THREADS > 1:
            try:
                pool = open_.enter_context(workers(1, beside=1))
            except InputError as error:
                log.debug("%s", error)
        yield pool


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """Keep Ctrl-C from a process that begins within this, which it would end in its imports with a traceback;
    this process hears of it afterwards.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_process(processes: int, parent: Connection) -> None:
    """Prepare a process that serves this one: it has its share of the cores, and ends when told, or when
    its parent is no more.
    """
    parallel.limit_threads(processes)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # reaches all processes of a terminal; the parent decides
    signal.signal(signal.SIGTERM, _end_when_told)
    Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_when_told(*_: Any) -> None:
    """End, with what is half made removed, and without a word: what an interrupted library says of it, such
    as that it cannot be imported, is no news.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    sys.exit(1)


def _end_with(parent: Connection) -> None:
    """Wait until the parent closes its end, or the system does it for one that died; then end, first as if
    told to.
    """
    parent.poll(None)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    os._exit(1)  # compiled code may have ignored the signal
