"""Tasks in processes that are watched: each within its limits of time and memory, and none costs another."""

from __future__ import annotations

import logging
import os
import subprocess
from collections import Counter, deque
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Generic, TypeVar

from ..errors import InputError
from .place import Death, Place, Task
from .workers import GRACE

POLL = 0.1  # seconds between two looks at a process
MB = 1_000_000
PROC = Path("/proc")  # of Linux; macOS has `ps`
log = logging.getLogger("o3dls")
T = TypeVar("T")


@dataclass(frozen=True)
class Limits:
    """Limits bound a task: seconds and bytes of resident memory (None: any); and how often it is begun again
    where its process was ended from outside. Raises InputError.
    """

    seconds: float | None = None
    memory: int | None = None
    retries: int = 1

    def __post_init__(self) -> None:
        if self.memory is not None and not resident(os.getpid()):
            raise InputError("--memory: this system does not say what memory a process has; leave it out")

    def exceeded(self, seconds: float, process: int) -> Death | None:
        """Return the limit that a task is beyond, after so many seconds in a process; None where it is within
        all.
        """
        if self.seconds is not None and seconds > self.seconds:
            said = f"took more than {self.seconds:g} s and was stopped (--timeout)"
            return Death(said, from_outside=False, of_this_task=True)
        if self.memory is not None and resident(process) > self.memory:
            said = f"took more than {self.memory / MB:g} MB of memory and was stopped (--memory)"
            return Death(
                said, from_outside=False, of_this_task=False
            )  # earlier tasks may have left memory taken
        return None


def resident(process: int) -> int:
    """Return the bytes of memory that a process has; 0 where it is no more, or the system does not say.
    Addresses would be no measure: compiled code and linear algebra reserve many more than they use.
    """
    try:
        if PROC.is_dir():
            pages = int((PROC / str(process) / "statm").read_text().split()[1])
            return pages * os.sysconf("SC_PAGE_SIZE")
        asked = subprocess.run(["ps", "-o", "rss=", "-p", str(process)], capture_output=True, text=True)
        return int(asked.stdout) * 1024
    except (OSError, ValueError, IndexError):
        return 0


@dataclass(frozen=True)
class Ended:
    """This is the result of a task whose process was ended: the reason why there is no other."""

    reason: str


def watched(
    tasks: Sequence[Task[T]], jobs: int, limits: Limits, stop: Event
) -> Generator[tuple[Task[T], T | Ended]]:
    """Do the tasks, so many at one time; each with its result, as they end.

    Once `stop` is set no more are begun. Closing this ends what runs.
    """
    places: list[Place[T]] = [Place(limits.exceeded, jobs - 1) for _ in range(min(jobs, len(tasks)))]
    try:
        yield from attended(places, tasks, limits, stop)
    finally:
        end(places)


def attended(
    places: Sequence[Place[T]], tasks: Sequence[Task[T]], limits: Limits, stop: Event
) -> Generator[tuple[Task[T], T | Ended]]:
    """Do the tasks as `watched` does, in given places, which are left open for tasks that come later."""
    line = _Line(tasks, limits)
    while busy := line.begun(places, stop):
        wait([place.future for place in busy], timeout=POLL, return_when=FIRST_COMPLETED)
        for place in busy:
            found = place.look()
            if found is None:
                continue
            task, result = found
            if not isinstance(result, Death):
                yield task, result
            elif not line.again(task, result):
                yield task, Ended(line.reason(task, result))


def end(places: Sequence[Place[T]]) -> None:
    """End what runs, all at one time: first as told to, then at once."""
    busy = [place for place in places if place.task]
    for place in busy:
        place.tell()
    wait([place.future for place in busy], timeout=GRACE)
    for place in busy:
        place.kill()
    for place in places:
        place.close()


class _Line(Generic[T]):
    """The line holds the tasks that wait, and what became of those that are begun again."""

    def __init__(self, tasks: Sequence[Task[T]], limits: Limits) -> None:
        self.waiting = deque(tasks)
        self.limits = limits
        self.deaths = Counter[Task[T]]()
        self.careful: set[Task[T]] = set()  # to be done in a fresh process
        self.told = False

    def begun(self, places: Sequence[Place[T]], stop: Event) -> list[Place[T]]:
        """Begin waiting tasks in the places that are free; the places that are at work."""
        for place in places:
            if not place.task and self.waiting and not stop.is_set():
                task = self.waiting.popleft()
                place.begin(task, fresh=task in self.careful)
        busy = [place for place in places if place.task]
        if stop.is_set() and not self.told:
            self.told = True
            log.info(
                "stopping: %d running end, %d are not begun; once more ends them at once",
                len(busy),
                len(self.waiting),
            )
        return busy

    def again(self, task: Task[T], death: Death) -> bool:
        """Return whether a task is begun again, as the last.

        What ended a process that had done other tasks may be of their making, and does not count.
        """
        if death.of_this_task:
            self.deaths[task] += death.from_outside
            if not death.from_outside or self.deaths[task] > self.limits.retries:
                return False
        self.careful.add(task)
        self.waiting.append(task)
        return True

    def reason(self, task: Task[T], death: Death) -> str:
        """Return why a task has no result."""
        if not death.from_outside:
            return death.reason
        times = "once" if self.deaths[task] == 1 else f"{self.deaths[task]} times"
        return f"its process was killed from outside, {times}; is there too little memory?"
