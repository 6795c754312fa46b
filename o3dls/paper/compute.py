"""`o3dls paper`: run every task, two at a time, write the numbers, then the page from the numbers alone."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..io.atomic import check_free, staged_folder
from ..io.manifest import write_manifest
from ..pipeline.workers import workers
from .experiment import Outcome, Scope, Task
from .page import EXPERIMENTS, write_page
from .results import read_results, write_results

log = logging.getLogger("o3dls")
DATA = "O3DLS_DATA"  # folder of third-party data; its experiments are left out where it is not set


def make(out: Path, *, quick: bool = False, force: bool = False) -> Path:
    """Compute everything into a new folder `out`, and return the page. Raises InputError before any work
    where the folder cannot be written.
    """
    check_free(out, force, "paper")
    scope = Scope(quick, Path(os.environ[DATA]) if DATA in os.environ else None)
    tasks = [task for experiment in EXPERIMENTS for task in experiment.tasks(scope)]
    outcomes: dict[str, list[Outcome]] = {}
    for task, outcome in zip(tasks, computed(tasks), strict=True):
        outcomes.setdefault(task.experiment, []).append(outcome)
    with staged_folder(out, force) as folder:
        write_results(folder, outcomes, left_out(scope), scope)
        shown(folder)
        write_manifest(folder)
    return out / "index.html"


def shown(folder: Path) -> Path:
    """Write the page of a results folder again."""
    return write_page(read_results(folder), folder)


def left_out(scope: Scope) -> dict[str, str]:
    """Say why experiments are not there, by name."""
    return {name: why for experiment in EXPERIMENTS for name, why in experiment.left_out(scope).items()}


def computed(tasks: Sequence[Task]) -> Iterator[Outcome]:
    """Yield outcomes in the order of the tasks; progress goes to the log."""
    with workers(min(2, os.cpu_count() or 1)) as pool:
        for k, outcome in enumerate(pool.map(_run_task, tasks), 1):
            log.info("paper: %d of %d: %s", k, len(tasks), tasks[k - 1].label)
            yield outcome


def _run_task(task: Task) -> Outcome:
    logging.getLogger("o3dls").setLevel(logging.WARNING)
    return task()
