"""A process that does what reads files and computes: what ends it does not end the server, and it ends with
the server.
"""

from __future__ import annotations

import logging
import os
import signal
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock
from time import monotonic
from typing import Any

from ..child_processes import safe_path
from ..errors import InputError, O3dlsError
from ..pipeline.pipeline import STEPS
from ..pipeline.place import KILL
from ..pipeline.supervision import Limits
from ..pipeline.workers import GRACE, begin_process

POLL = 0.1  # seconds between two looks at the limits
Message = dict[str, Any]
Tell = Callable[[Message], None]
Task = Callable[[Tell], Any]  # a partial of a function of a module, since it is sent to the process


class Lost(O3dlsError):
    """The process of a task was ended, from outside or because somebody cancelled it."""


class Worker:
    """A worker is a process that does one task at a time, with a folder as its working folder. It is begun at
    once, since its imports take longer than most tasks.
    """

    def __init__(self, folder: Path, limits: Limits | None = None) -> None:
        spawn = get_context("spawn")  # fork hangs once numba has used its threads
        self._work, theirs = spawn.Pipe()
        life, self._life = spawn.Pipe(duplex=False)  # closed by the system when the server dies
        self._limits = limits or Limits()
        self._process = spawn.Process(target=_serve, args=(theirs, life, folder))
        with safe_path():
            self._process.start()
        theirs.close()
        life.close()

    @property
    def alive(self) -> bool:
        """Whether the process is there."""
        return self._process.is_alive()

    def do(self, task: Task, told: Tell | None = None) -> Any:
        """Do a task and return its result; `told` is called with what it says of its progress.

        Raises O3dlsError as the task does, InputError where it is beyond a limit, Lost where its process was
        ended.
        """
        begun = monotonic()
        try:
            self._work.send(task)
            while True:
                if not self._work.poll(POLL):
                    self._heed_limits(monotonic() - begun)
                    continue
                kind, content = self._work.recv()
                if kind == "done":
                    return content
                if kind == "failed":
                    raise content
                if told:
                    told(content)
        except (EOFError, OSError):
            raise Lost("its process was ended") from None

    def end(self) -> None:
        """End the process, first as told to, so that it removes what is half made, and then at once."""
        for number in (signal.SIGTERM, KILL):
            if self._process.pid and self._process.is_alive():
                with suppress(ProcessLookupError):
                    os.kill(self._process.pid, number)
                self._process.join(GRACE)

    def _heed_limits(self, seconds: float) -> None:
        if death := self._limits.exceeded(seconds, self._process.pid or 0):
            self.end()
            raise InputError(death.reason)


class Reader:
    """The reader is a worker that answers pages, one after the other, and is replaced where it was ended."""

    def __init__(self, folder: Path, limits: Limits | None = None) -> None:
        self._make = partial(Worker, folder, limits)
        self._turn, self._worker = Lock(), self._make()

    def do(self, task: Task) -> Any:
        """Do a task; where a process was killed that had been idle, another does it."""
        with self._turn:
            if not self._worker.alive:
                self._worker = self._make()
            return self._worker.do(task)

    def end(self) -> None:
        """End the process."""
        self._worker.end()


class _Lines(logging.Handler):
    """This handler gives the server the lines of the log, and says which of them end a step of a run."""

    def __init__(self, tell: Tell) -> None:
        super().__init__(logging.INFO)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell({"line": record.getMessage(), "step": record.msg in STEPS})


def _serve(work: Connection, life: Connection, folder: Path) -> None:
    """Do the tasks that are sent, until the server ends."""
    begin_process(1, life)
    os.chdir(folder)

    def tell(message: Message) -> None:
        work.send(("said", message))

    log = logging.getLogger("o3dls")
    log.setLevel(logging.INFO)
    log.addHandler(_Lines(tell))
    _import_readers()
    with suppress(EOFError, OSError):  # the server has gone
        while True:
            work.send(_do_task(work.recv(), tell))


def _import_readers() -> None:
    """Import what the first task needs, while nobody waits for it."""
    from ..pipeline import new_case  # noqa: F401
    from ..report.drawing import pictures, raster  # noqa: F401
    from ..report.surfaces import display  # noqa: F401


def _do_task(task: Task, tell: Tell) -> tuple[str, Any]:
    """Return what comes of a task; our own mistakes are told as such."""
    try:
        return "done", task(tell)
    except O3dlsError as error:
        return "failed", error
    except OSError as error:
        return "failed", InputError(str(error))
    except MemoryError:
        return "failed", InputError("there was too little memory; close other programs, or take less data")
    except Exception as error:
        traceback.print_exc()
        said = f"internal error, please report it: {type(error).__name__}: {error}"
        return "failed", InputError(said)
