"""Full fits in a process of their own: one at a time, with one thread, and at low priority once there is an
estimate, so that no point waits for one.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from time import monotonic

from ..pipeline.workers import workers
from .fitting import FullFit, full_fit
from .session import Session

NICE = 19  # steps of priority below what answers
# Linux gives every session of processes its share of the cores, and counts priorities within one only
AUTOGROUP = Path("/proc/self/autogroup")
CORES = os.cpu_count() or 1  # as many processes share them: one thread is left


class Background:
    """The process of the full fits. done: called, in a thread of its own, when a fit has ended.

    Use as a context: what runs at its end is ended.
    """

    def __init__(self, done: Callable[[FullFit], None]) -> None:
        self._done = done
        self._open = ExitStack()
        self._pool: Executor | None = None
        self._since: float | None = None
        self._first = True  # of its process: nothing is shown before it, so it is in a hurry

    def __enter__(self) -> Background:
        self._process()  # its imports take longer than a fit
        return self

    def __exit__(self, *error: object) -> None:
        self._open.__exit__(SystemExit, SystemExit(), None)  # what runs is not waited for

    @property
    def seconds(self) -> float | None:
        """For how long a fit has been running; None where none does."""
        return None if self._since is None else monotonic() - self._since

    def begin(self, session: Session) -> None:
        """Begin a full fit of a session as it is now."""
        kept = session.copy()
        self._since = monotonic()
        try:
            future = self._process().submit(full_fit, kept)
        except BrokenProcessPool:  # ended while it had nothing to do
            self._pool = None
            future = self._process().submit(full_fit, kept)
        future.add_done_callback(lambda ended: self._ended(kept, ended))

    def taken(self) -> None:
        """The result of the last fit has been taken over."""
        self._since = None
        if self._first and self._pool is not None:
            self._first = False
            self._pool.submit(_step_back)

    def _process(self) -> Executor:
        if self._pool is None:
            self._pool = self._open.enter_context(workers(1, CORES))
            self._first = True
            self._pool.submit(_prepare)
        return self._pool

    def _ended(self, session: Session, future: Future[FullFit]) -> None:
        if future.cancelled():
            return
        try:
            result = future.result()
        except BrokenProcessPool:
            self._pool = None
            result = FullFit(session, refused="its process was ended from outside", lost=True)
        except Exception as error:  # our own mistake in a fit must not cost the session
            result = FullFit(session, refused=f"internal error, please report it: {error!r}")
        self._done(replace(result, session=session))


def _prepare() -> None:
    """Have everything imported that a fit needs."""
    from ..stages.deform import Deform  # noqa: F401


def _step_back() -> None:
    """Stand back behind the process that takes the points, and behind the pages."""
    if hasattr(os, "nice"):
        os.nice(NICE)
    if AUTOGROUP.exists() and os.getpid() != os.getsid(0):
        os.setsid()
        AUTOGROUP.write_text(str(NICE))
