"""What a worker of a scheduler does with a task, and the file by which the batch tells it to end."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import current_process
from pathlib import Path
from threading import Event
from typing import Any, TypeVar

from ..errors import InputError
from ..io.atomic import write_file
from ..runs.scoring import version_of
from .place import Death, Place, Task
from .supervision import Ended, Limits, attended

BEGIN, STOP = "begin\n", "begin no more\n"
NO_MORE = Death("the batch was ended", from_outside=False, of_this_task=True)
# a worker has one core per thread: a nanny limits linear algebra to it, and nobody limits numba
ONE_CORE = ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
T = TypeVar("T")


@dataclass(frozen=True)
class Order:
    """An order is a file in the folder of the runs, which the client writes and every worker looks at: it
    says whether tasks may be begun; where it is gone those that run are ended.
    """

    path: Path
    version: str | None

    @property
    def stopped(self) -> bool:
        """Whether no more tasks shall be begun."""
        return self.path.read_text(encoding="utf-8") != BEGIN

    def stop(self) -> None:
        """Tell the workers to begin no more tasks."""
        write_file(self.path, STOP)

    def fault(self, reads: Path | None = None) -> str | None:
        """Return what keeps this machine from doing a task, which reads a folder; None where nothing does."""
        if not self.path.is_file():
            return f"does not see {self.path.parent}, where the runs shall go; name a folder that all share"
        if reads and not reads.is_dir():
            return f"does not see the case {reads}; cases must stand in a folder that all share"
        if (here := version_of("o3dls")) != self.version:
            return f"has o3dls {here}, and this is {self.version}; install the same"
        return None


@contextmanager
def ordered(out: Path) -> Iterator[Order]:
    """Yield an order in the folder of the runs, which is removed when the block ends."""
    # the name is that of a half-made file, so that it is removed like one if its process was killed
    path = out.absolute() / f".batch.partial-{os.getpid():x}-{secrets.token_hex(4)}"
    write_file(path, BEGIN)
    try:
        yield Order(path, version_of("o3dls"))
    finally:
        path.unlink(missing_ok=True)


def done_here(task: Task[T], limits: Limits, order: Order, reads: Path | None) -> T | Ended | None:
    """Do a task in a watched process of this worker; None where no more shall be begun. The process is kept
    for the next task of the batch.

    Raises InputError where this machine cannot do it.
    """
    from distributed import get_worker

    if fault := order.fault(reads):
        raise InputError(f"worker {get_worker().address}: {fault}")
    if order.stopped:
        return None
    place = _take_place(order, limits)
    ((_, result),) = attended([place], [task], limits, Event())
    task.abandoned()  # removes what was left by a worker that was lost with its process
    _free.append((order, place))
    return result


def released() -> None:
    """End the processes of this worker that have nothing to do."""
    with suppress(IndexError):
        while True:
            _free.pop()[1].close()


_free: list[tuple[Order, Place[Any]]] = []  # what this worker keeps; its threads take from it


def _take_place(order: Order, limits: Limits) -> Place[Any]:
    """Return a place that is free, or a new one."""
    with suppress(IndexError):
        while True:
            of, place = _free.pop()
            if of == order:
                return place
            place.close()  # it belongs to another batch, which has ended or can begin a new process
    for name in ONE_CORE:
        os.environ.setdefault(name, "1")
    if current_process().daemon:  # a daemon may not begin processes, and the workers of a nanny are daemons
        current_process().daemon = False
    return Place(lambda *taken: limits.exceeded(*taken) or (None if order.path.exists() else NO_MORE), 0)
