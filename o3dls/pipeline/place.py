"""A place at which tasks are done one after the other, by a process that is watched and replaced."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from typing import Any, Generic, Protocol, TypeVar

from .workers import GRACE, workers

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
KILL = signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL


class Task(Protocol[T_co]):
    """A task is the work that a process shall do, and the name of what comes of it."""

    @property
    def name(self) -> str: ...

    @property
    def reads(self) -> Path:
        """The folder that it reads."""

    def __call__(self) -> T_co: ...

    def abandoned(self, process: int | None = None) -> None:
        """Remove what a process that was ended left half made, or any that did."""


@dataclass(frozen=True)
class Death:
    """This says how the process of a task ended: beyond a limit for a reason, or from outside; and whether
    the task alone is to blame, and none that its process had done before.
    """

    reason: str
    from_outside: bool
    of_this_task: bool


OUTSIDE = Death("killed from outside", from_outside=True, of_this_task=False)


class Place(Generic[T]):
    """A place runs tasks in a process, begun when a task needs one.

    It has a pool of its own: in one of several processes, the death of one fails the tasks of all, or, in
    pebble's (5.2), leaves for ever without a result those that it was taking and that come after.
    exceeded: which limit a task is beyond, by its seconds and its process; beside: how many other places
    there are. future, process: of what is done now; the process is known once it has begun.
    """

    future: Future[Any]

    def __init__(self, exceeded: Callable[[float, int], Death | None], beside: int) -> None:
        self.task: Task[T] | None = None
        self.process: int | None = None
        self._exceeded, self._beside = exceeded, beside
        self._pool: Executor | None = None
        self._open = ExitStack()
        self._done = 0  # tasks of this process
        self._begun = self._told = 0.0
        self._beyond: Death | None = None

    def begin(self, task: Task[T], *, fresh: bool) -> None:
        """Begin a task, in a fresh process where it shall have one."""
        if fresh and self._done:
            self.close()
        self.task, self._beyond = task, None
        if self._pool and self.process:
            self._submit_task(self._pool, task)
        else:
            self._start_process()

    def look(self) -> tuple[Task[T], T | Death] | None:
        """Return the task with its result, or with how its process ended; None while it is at work."""
        task = self.task
        if task is None or not self.future.done():
            self._heed_limits()
            return None
        try:
            result = self.future.result()
        except BrokenProcessPool:
            return task, self._close_dead(task)
        if self.process is None and self._pool:
            self.process = result
            self._submit_task(self._pool, task)
            return None
        if self._beyond:
            return task, self._close_dead(task)
        self._done += 1
        self.task = None
        return task, result

    def tell(self) -> None:
        """Tell the process to end, with what is half made removed."""
        self._told = monotonic()
        self._send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End the process at once, if it is at work still."""
        self._send_signal(KILL)

    def close(self) -> None:
        """Wait for the process to end; what it left half made is removed."""
        self._open.close()
        if self.task and self.process:
            self.task.abandoned(self.process)
        self.task = self.process = self._pool = None
        self._done = 0

    def _start_process(self) -> None:
        self._pool = self._open.enter_context(workers(1, self._beside))
        self.future = self._pool.submit(os.getpid)  # its imports are no part of the task's time

    def _submit_task(self, pool: Executor, task: Task[T]) -> None:
        try:
            self.future = pool.submit(task)
        except BrokenProcessPool:  # ended while it had nothing to do
            self.task = None
            self.close()
            self.task = task
            self._start_process()
        self._begun = monotonic()

    def _heed_limits(self) -> None:
        """Tell a process that is beyond a limit to end, and end it where it does not."""
        now = monotonic()
        if self.process is None:
            return
        if self._beyond is None:
            self._beyond = self._exceeded(now - self._begun, self.process)
            if self._beyond:
                self.tell()
        elif now - self._told > GRACE:
            self.kill()

    def _close_dead(self, task: Task[T]) -> Death:
        death, first = self._beyond or OUTSIDE, not self._done
        self.close()
        return replace(death, of_this_task=first or death.of_this_task)

    def _send_signal(self, number: int) -> None:
        if self.process and not self.future.done():
            with suppress(ProcessLookupError):
                os.kill(self.process, number)
