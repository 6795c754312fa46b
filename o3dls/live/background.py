"""Full fits in a process of their own: one at a time, with one thread, and once there is an estimate at low
priority and held while a point is put in and drawn, so that no point waits for one.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from time import monotonic

from ..pipeline.workers import workers
from .fitting import FullFit, full_fit, prepare
from .session import Session

HELD = 0.25  # seconds that a fit is held for a point: most are drawn by then
SHARE = 0.5  # most of its time that a fit is held, or it would never end where points come fast
NICE = 19  # steps of priority below what answers
# Linux gives every session of processes its share of the cores, and counts priorities within one only
AUTOGROUP = Path("/proc/self/autogroup")
END_WITH_PARENT = 1  # prctl(2): PR_SET_PDEATHSIG
CORES = os.cpu_count() or 1  # as many processes share them: one thread is left


class Background:
    """This class runs the full fits in a process of their own. done: called, in a thread of its own, when a
    fit has ended.

    Use as a context: what runs at its end is ended.
    """

    def __init__(self, done: Callable[[FullFit], None]) -> None:
        self._done = done
        self._open = ExitStack()
        self._pool: Executor | None = None
        self._since: float | None = None
        self._first = True  # the first fit of a process has normal priority: nothing is shown before it
        self._pid: int | None = None  # set once the process may be held
        self._held = 0.0  # seconds for which the running fit was held
        self._held_since: float | None = None
        self.held_until: float | None = None  # when a fit that is held should go on

    def __enter__(self) -> Background:
        return self

    def __exit__(self, *error: object) -> None:
        self.go_on()
        self._open.__exit__(SystemExit, SystemExit(), None)  # what runs is not waited for

    def start(self) -> None:
        """Begin the process before there is a fit, since its imports take longer than one."""
        self._start_process()

    @property
    def seconds(self) -> float | None:
        """For how long a fit has been running; None where none does."""
        return None if self._since is None else monotonic() - self._since

    def begin(self, session: Session) -> None:
        """Begin a full fit of a session as it is now."""
        kept = session.copy()
        self._since, self._held = monotonic(), 0.0
        try:
            future = self._start_process().submit(full_fit, kept)
        except BrokenProcessPool:  # the process ended while it was idle
            self._forget_process()
            future = self._start_process().submit(full_fit, kept)
        future.add_done_callback(lambda ended: self._hand_over(kept, ended))

    def taken(self) -> None:
        """Note that the result of the last fit has been taken over."""
        self.go_on()
        self._since = None
        if self._first and self._pool is not None:
            self._first = False
            self._pool.submit(_step_back).add_done_callback(self._allow_holding)

    def make_way(self) -> None:
        """Hold the fit that runs, as a point has come, or let it go on where it was held for long enough."""
        if sys.platform != "linux" or self._since is None or self._pid is None:
            return
        now = monotonic()
        held = self._held + (0.0 if self._held_since is None else now - self._held_since)
        if held > SHARE * (now - self._since):
            self.go_on()
            return
        self.held_until = now + HELD
        if self._held_since is None:
            self._held_since = now
            self._send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """Let a fit go on that is held."""
        if sys.platform != "linux" or self._held_since is None:
            return
        self._send_signal(signal.SIGCONT)
        self._held += monotonic() - self._held_since
        self._held_since = self.held_until = None

    def _send_signal(self, number: int) -> None:
        pid = self._pid
        if pid is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, number)

    def _allow_holding(self, stepped_back: Future[int]) -> None:
        if not stepped_back.cancelled() and stepped_back.exception() is None:
            self._pid = stepped_back.result()

    def _forget_process(self) -> None:
        """Forget the process, which was ended from outside."""
        self._pool = self._pid = None

    def _start_process(self) -> Executor:
        if self._pool is None:
            self._pool = self._open.enter_context(workers(1, CORES))
            self._first = True
            self._pool.submit(prepare)
        return self._pool

    def _hand_over(self, session: Session, future: Future[FullFit]) -> None:
        if future.cancelled():
            return
        try:
            result = future.result()
        except BrokenProcessPool:
            self._forget_process()
            result = FullFit(session, refused="its process was ended from outside", lost=True)
        except SystemExit:  # the process was told to end with the session
            return
        except Exception as error:  # our own mistake in a fit must not cost the session
            result = FullFit(session, refused=f"internal error, please report it: {error!r}")
        self._done(replace(result, session=session))


def _step_back() -> int:
    """Give way to the process that takes the points, and to the pages; return the process's number."""
    if hasattr(os, "nice"):
        os.nice(NICE)
    if AUTOGROUP.exists() and os.getpid() != os.getsid(0):
        os.setsid()
        with suppress(BlockingIOError):  # for all users but root, Linux takes ten such changes a second
            AUTOGROUP.write_text(str(NICE))
    if sys.platform == "linux":  # a held process cannot notice that its parent has died
        ctypes.CDLL(None).prctl(END_WITH_PARENT, signal.SIGKILL)
    return os.getpid()
