"""Tasks on the workers of a scheduler of dask, which may be on this machine, others, or a queue's."""

from __future__ import annotations

import logging
import os
import re
import signal
import socket
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event
from time import monotonic
from typing import Any, Generic, TypeVar

from ..child_processes import SAFE_PATH, kept_environment, safe_path
from ..errors import InputError
from .on_worker import Order, done_here, ordered, released
from .place import Task
from .supervision import Ended, Limits, watched

LOCAL = "local"  # in place of an address: a scheduler of our own
ADDRESS = re.compile(r"(tcp|tls)://(.+):(\d{1,5})")
GREETING = 100_000  # bytes, at most, of a scheduler's first message
ANSWERS = 5.0  # seconds in which a scheduler must answer
POLL = 0.2  # seconds between two looks at what the user wants
QUIET = 10.0  # seconds without a result after which we look whether there are workers
# what dask does a hundred times a second for its dashboard, which nobody sees, on cores that the cases need
QUIETER = {"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "200ms"}
SET_BY_DASK = ("PYTHONHASHSEED", "__DASK_PARENT_PID")  # besides what its settings name
log = logging.getLogger("o3dls")
T = TypeVar("T")


@dataclass(frozen=True)
class Workers:
    """Workers run the cases, each within the limits: `jobs` of this machine at one time, or those of a
    scheduler of dask, `tcp://host:port`, all of which must see the folders (`local`: a scheduler of our own,
    with `jobs` workers of this machine). Once `stop` is set they begin no more.
    """

    jobs: int = 1
    scheduler: str | None = None
    limits: Limits = field(default_factory=Limits)
    stop: Event = field(default_factory=Event)

    def results(self, tasks: Sequence[Task[T]], out: Path) -> Generator[tuple[Task[T], T | Ended]]:
        """Do the tasks, and yield each with its result, as they end."""
        if self.scheduler:
            return spread(tasks, self.scheduler, self.jobs, self.limits, self.stop, out)
        return watched(tasks, self.jobs, self.limits, self.stop)


def spread(
    tasks: Sequence[Task[T]], address: str, jobs: int, limits: Limits, stop: Event, out: Path
) -> Generator[tuple[Task[T], T | Ended]]:
    """Do the tasks on the workers of the scheduler at an address, or on so many of our own where it is
    `local`; each with its result, as they end, as `watched` does it.

    out: the folder of the runs, which every worker must see. A task whose worker was lost is begun again on
    another. Once `stop` is set no more are begun. Closing this ends what runs. Raises InputError.
    """
    with client_of(address, jobs) as client, ordered(out) as order:
        _check_workers(client, order)
        sent: _Spread[T] = _Spread(client, order, limits)
        yield from sent.results(tasks, stop)


@contextmanager
def client_of(address: str, jobs: int) -> Iterator[Any]:
    """Yield a client of the scheduler at an address, or of one with so many workers that ends with the block.

    Raises InputError where dask is not installed, or none answers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--scheduler: needs dask.distributed, which is not installed: pip install 'o3dls[cluster]'"
        ) from None
    logging.getLogger("distributed").propagate = False  # distributed prints warnings by a handler of its own
    if address == LOCAL:
        with _local_cluster(jobs) as cluster, Client(cluster, set_as_default=False) as client:
            client.register_plugin(_ignore_interrupts())
            yield client
        return
    try:
        _check_address(address)
        opened = Client(address, timeout=ANSWERS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler: no scheduler answers at {address} ({type(error).__name__}): begin one with `dask "
            "scheduler`, which says its address"
        ) from None
    with opened as client:
        yield client


def _check_address(address: str) -> None:
    """Raise InputError for what is no address, and OSError where no scheduler is there: dask itself waits for
    ever for one that says nothing.
    """
    found = ADDRESS.fullmatch(address)
    if not found or int(found[3]) > 65535:
        raise InputError(
            f"--scheduler: '{address}': must be {LOCAL}, or the address of a scheduler, such as tcp://host:8786"
        )
    if found[1] == "tcp":
        with socket.create_connection((found[2].strip("[]"), int(found[3])), ANSWERS) as line:
            first = line.makefile("rb").read(8)  # how many bytes its greeting has
        if len(first) < 8 or int.from_bytes(first, "little") > GREETING:
            raise ConnectionError


@contextmanager
def _local_cluster(workers: int) -> Iterator[Any]:
    """Yield workers on this machine, of one task each, which share its cores."""
    import dask
    from distributed import LocalCluster

    settings: dict[str, Any] = {**QUIETER, f"distributed.nanny.pre-spawn-environ.{SAFE_PATH}": "1"}
    if not os.environ.get("NUMBA_NUM_THREADS"):
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        settings["distributed.nanny.pre-spawn-environ.NUMBA_NUM_THREADS"] = max(1, cores // workers)
    with (
        dask.config.set(settings),
        kept_environment((*dask.config.get("distributed.nanny.pre-spawn-environ"), *SET_BY_DASK)),
    ):
        with safe_path():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=0,
                dashboard_address="127.0.0.1:0",  # any port: one that is taken would be warned of
                silence_logs="ERROR",
            )
        with cluster:
            yield cluster


def _ignore_interrupts() -> Any:
    """Return a plugin by which workers, also those that replace others, ignore Ctrl-C, which reaches all
    processes of a terminal: the client tells them.
    """
    from distributed import WorkerPlugin

    class Deaf(WorkerPlugin):
        def setup(self, worker: Any) -> None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    return Deaf()


def _check_workers(client: Any, order: Order) -> None:
    """Raise InputError where a worker cannot do the tasks."""
    for worker, said in client.run(order.fault, on_error="return").items():
        if isinstance(said, Exception):
            said = _describe_unfit(said)
        if said:
            raise InputError(f"worker {worker}: {said}")


def _describe_unfit(error: BaseException) -> str:
    # dask reports an import that failed as an error of its own, several lines long: what it came of says more
    while error.__cause__:
        error = error.__cause__
    return f"cannot begin a case: {type(error).__name__}: {error}; install the same Python, dask and o3dls"


class _Spread(Generic[T]):
    """This holds the tasks that were given to a scheduler."""

    def __init__(self, client: Any, order: Order, limits: Limits) -> None:
        self.client, self.order, self.limits = client, order, limits
        self.open: dict[str, tuple[Task[T], Any]] = {}  # with their futures, by the key
        self.ended = SimpleQueue[Any]()
        self.deaths = Counter[Task[T]]()
        self.submitted = 0
        self.heard = 0.0  # when there was news last
        self.told = False

    def results(self, tasks: Sequence[Task[T]], stop: Event) -> Generator[tuple[Task[T], T | Ended]]:
        """Yield the tasks with their results, as they end."""
        try:
            for task in tasks:
                self._submit_task(task)
            while self.open:
                if stop.is_set() and not self.told:
                    self._stop_waiting()
                with suppress(Empty):
                    yield from self._take_ended(self.ended.get(timeout=POLL))
                self._warn_no_worker()
        finally:
            self.order.path.unlink(missing_ok=True)  # its absence tells workers to end what runs
            if self.client.status == "running":
                self.client.cancel([future for _, future in self.open.values()])
                self.client.run(released, on_error="ignore")

    def _submit_task(self, task: Task[T]) -> None:
        # One prefix for all: a scheduler keeps back what its workers cannot begin yet only of a large group.
        # What it has given to a worker counts as failed when that worker is lost.
        self.submitted += 1
        key = f"o3dls-{self.submitted}-{self.order.path.suffix[1:]}"
        reads = task.reads if task.reads.is_dir() else None  # else the task itself says what is wrong
        future = self.client.submit(done_here, task, self.limits, self.order, reads, key=key, pure=False)
        self.open[key] = task, future
        future.add_done_callback(self.ended.put)

    def _take_ended(self, future: Any) -> Iterator[tuple[Task[T], T | Ended]]:
        self.heard = monotonic()
        task, _ = self.open.pop(future.key, (None, None))
        result = self._take_result(future, task) if task else None
        if task and result is not None:
            yield task, result

    def _take_result(self, future: Any, task: Task[T]) -> T | Ended | None:
        """Return the result of a task; None where it was not begun, or is begun again."""
        from distributed import KilledWorker

        try:
            found: T | Ended | None = future.result()
        except KilledWorker:
            self.deaths[task] += 1
            if self.deaths[task] > self.limits.retries:
                task.abandoned()
                return Ended("the workers that had it were lost again and again; is there too little memory?")
            self._submit_task(task)
            return None
        except CancelledError:
            raise InputError(
                "the scheduler was lost, or restarted; what is done is kept: give the command again to go on"
            ) from None
        except InputError:
            raise
        except Exception as error:
            raise InputError(f"a worker {_describe_unfit(error)}") from error
        return found

    def _stop_waiting(self) -> None:
        """Begin no more: what no worker has been given is taken back, and workers hear of it."""
        self.told = True
        self.order.stop()
        given = {key for keys in self.client.processing().values() for key in keys}
        self.client.cancel([self.open.pop(key)[1] for key in self.open.keys() - given])
        log.info("stopping: what runs ends, and no more is begun; once more ends it at once")

    def _warn_no_worker(self) -> None:
        """Say where there is nobody to do the tasks."""
        if self.open and monotonic() - self.heard > QUIET:
            self.heard = monotonic()
            if self.client.status == "running" and not self.client.nthreads():
                log.warning("the scheduler has no worker: %d cases wait for one", len(self.open))
