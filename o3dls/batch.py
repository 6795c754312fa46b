"""One pipeline over many cases, each in a process of its own, and one table of the cohort."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from .case import Case
from .errors import InputError, O3dlsError
from .io.atomic import check_free
from .io.case_folder import read_case
from .levelset.compiled import share
from .pipeline import Pipeline
from .run import Run
from .run_folder import log_of_failure, write_rows
from .tables import score_rows

log = logging.getLogger("o3dls")
COHORT = "cohort.csv"


@dataclass(frozen=True)
class Outcome:
    """What became of one case: rows of its scores, or the sentence that says why there are none."""

    case: str
    rows: list[dict[str, Any]]
    faults: list[str]
    error: str | None = None


def run_into(pipeline: Pipeline, case: Case, out: Path, *, force: bool = False) -> Run:
    """Run a pipeline and write its folder; a failure leaves only a log beside it that says why."""
    check_free(out, force)
    with log_of_failure(out):
        run = pipeline.run(case)
        run.write(out, force=force)
    return run


def run_cohort(
    folders: Sequence[Path], pipeline: Pipeline, out: Path, *, jobs: int = 1, trim: bool = False, force: bool = False
) -> list[Outcome]:
    """Run the pipeline on every case folder into `out/<name of the folder>` and write `out/cohort.csv`.

    trim: leave out what a case does not allow, as for the default pipeline. A case that fails does not stop the others.
    Raises InputError before any work where two cases have one name or a run folder exists.
    """
    names = [folder.resolve().name for folder in folders]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two case folders are named '{name}': their runs would have one folder")
        check_free(out / name, force)
    one = partial(_outcome, pipeline=pipeline, out=out, trim=trim, force=force)
    spawn = get_context("spawn")  # fork hangs once numba has used its threads
    with ProcessPoolExecutor(jobs, spawn, initializer=share, initargs=(jobs,)) as pool:
        outcomes = list(pool.map(one, folders))
    out.mkdir(parents=True, exist_ok=True)
    write_rows(out / COHORT, [row for outcome in outcomes for row in cohort_rows(outcome)])
    return outcomes


def cohort_rows(outcome: Outcome) -> list[dict[str, Any]]:
    """Rows of the cohort's table: case, error, faults of its final surface, then the columns of scores.csv."""
    head = {"case": outcome.case, "error": outcome.error or "", "faults": "; ".join(outcome.faults)}
    return [head | row for row in outcome.rows] or [head]


def _outcome(folder: Path, pipeline: Pipeline, out: Path, trim: bool, force: bool) -> Outcome:
    name = folder.resolve().name
    try:
        case = read_case(folder)
        run = run_into(pipeline.allowed_by(case) if trim else pipeline, case, out / name, force=force)
    except O3dlsError as error:
        return Outcome(name, [], [], str(error))
    return Outcome(name, score_rows(run), run.faults)
