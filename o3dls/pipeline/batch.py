"""One pipeline over many cases, each in a process of its own, and one table of the cohort."""

from __future__ import annotations

import logging
import os
import traceback
from collections.abc import Generator, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..case import Case
from ..errors import InputError, O3dlsError
from ..io.atomic import check_free
from ..io.case_reader import read_case
from ..runs.estimate_files import write_rows
from ..runs.log import log_of_failure, recorded_log
from ..runs.run import Run
from ..runs.tables import score_rows
from .pipeline import Pipeline
from .workers import workers

log = logging.getLogger("o3dls")
COHORT, PAGE = "cohort.csv", "cohort.html"  # the page is the report's: see report/writer.py


@dataclass(frozen=True)
class Outcome:
    """What became of one case, and what it was warned of.

    Rows of its scores, or the sentence that says why there are none.
    """

    case: str
    rows: list[dict[str, Any]]
    faults: list[str]
    error: str | None = None
    warnings: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return f"{self.case}: {self.error or '; '.join(self.faults) or 'done'}"


def run_into(pipeline: Pipeline, case: Case, out: Path, *, force: bool = False) -> Run:
    """Run a pipeline and write its folder; a failure leaves only a log beside it that says why."""
    check_free(out, force, "run")
    with log_of_failure(out):
        run = pipeline.run(case)
        run.write(out, force=force)
    return run


def run_cohort(
    folders: Sequence[Path],
    pipeline: Pipeline,
    out: Path,
    *,
    jobs: int = 1,
    trim: bool = False,
    force: bool = False,
) -> list[Outcome]:
    """Run the pipeline on every case folder into `out/<name of the folder>` and write `out/cohort.csv`.

    trim: leave out what a case does not allow, as for the default pipeline. A case that fails does not stop
    the others, and the table is there from the first case on; the page of an earlier batch is removed. Raises
    InputError before any work where a case has the name of another, of the table or of the page, or a run
    folder or one of these exists.
    """
    names = [folder.resolve().name for folder in folders]
    for folder, name in zip(folders, names, strict=True):
        if names.count(name) > 1:
            raise InputError(f"two case folders are named '{name}': their runs would have one folder")
        if name.casefold() in (COHORT, PAGE):
            kind = "table" if name.casefold() == COHORT else "page"
            raise InputError(f"{folder}: '{name}' is the name of the batch's {kind}; rename the case folder")
        check_free(out / name, force, "run", folders)
    for path in (out / COHORT, out / PAGE):
        _check_own(path, force)
    work = [
        _Job(folder, pipeline, out / name, trim, force) for folder, name in zip(folders, names, strict=True)
    ]
    (out / PAGE).unlink(missing_ok=True)  # it speaks of runs that are replaced now
    found: dict[_Job, Outcome] = {}
    with closing(_outcomes(work, jobs)) as outcomes:  # an interruption ends the processes at once
        for job, outcome in outcomes:
            found[job] = outcome
            log.info("%d of %d: %s", len(found), len(work), outcome)
            rows = [row for job in work if job in found for row in cohort_rows(found[job])]
            write_rows(out / COHORT, rows)
    return [found[job] for job in work]


def _check_own(path: Path, force: bool) -> None:
    if path.is_dir():
        raise InputError(f"{path}: is a folder, and the batch writes a file there; name another folder")
    if path.exists() and not force:
        raise InputError(f"{path}: exists already; name another folder or use --force")


def cohort_rows(outcome: Outcome) -> list[dict[str, Any]]:
    """Rows of the cohort's table.

    Case, error, faults of its final surface, warnings, then the columns of scores.csv.
    """
    said = {"faults": "; ".join(outcome.faults), "warnings": "; ".join(outcome.warnings)}
    head = {"case": outcome.case, "error": outcome.error or "", **said}
    return [head | row for row in outcome.rows] or [head]


@dataclass(frozen=True, eq=False)
class _Job:
    """One case, what to do with it, and where its run goes."""

    folder: Path
    pipeline: Pipeline
    out: Path
    trim: bool
    force: bool

    def __call__(self) -> Outcome:
        with recorded_log(logging.WARNING) as warnings:
            try:
                run = self._run()
            except (O3dlsError, OSError) as error:
                return Outcome(self.out.name, [], [], str(error), warnings)
            except Exception as error:  # our own mistake in one case must not cost the others
                traceback.print_exc()
                return Outcome(
                    self.out.name,
                    [],
                    [],
                    f"internal error, please report it: {type(error).__name__}: {error}",
                    warnings,
                )
            except SystemExit:
                # told to end: the pool would take it for the case's error, and go on with the next
                os._exit(1)
        return Outcome(self.out.name, score_rows(run.scores), run.faults, None, warnings)

    def _run(self) -> Run:
        case = read_case(self.folder)
        return run_into(
            self.pipeline.allowed_by(case) if self.trim else self.pipeline, case, self.out, force=self.force
        )


def _outcomes(work: Sequence[_Job], jobs: int) -> Generator[tuple[_Job, Outcome], None, None]:
    """Do the jobs, so many at one time; each with its outcome, as they end.

    Once a process was ended from outside, those that are left one by one: memory may be short.
    """
    left = []
    with workers(max(1, min(jobs, len(work)))) as pool:
        futures = {pool.submit(job): job for job in work}
        for future in as_completed(futures):
            if outcome := _outcome(future):
                yield futures[future], outcome
            else:
                left.append(futures[future])
    for job in work:
        if job in left:
            yield job, _alone(job)


def _alone(job: _Job) -> Outcome:
    with workers(1) as pool:
        ended = (
            "its process was ended from outside, also when it was the only one; is there too little memory?"
        )
        return _outcome(pool.submit(job)) or Outcome(job.out.name, [], [], ended)


def _outcome(future: Future[Outcome]) -> Outcome | None:
    """The outcome of a job, once it is there, None where its process was ended.

    Its warnings go to the log.
    """
    try:
        outcome = future.result()
    except BrokenProcessPool:
        return None
    for warning in outcome.warnings:
        log.warning("%s: %s", outcome.case, warning)
    return outcome
