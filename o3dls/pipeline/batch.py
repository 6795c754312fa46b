"""Many cases, each in a process of its own, and one table of the cohort."""

from __future__ import annotations

import logging
import os
import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event
from time import perf_counter

from ..case import Case
from ..errors import InputError, O3dlsError
from ..io.atomic import check_free
from ..io.case_reader import read_case
from ..places import check_inside, check_name, remove_partial, sole_writer, temporary_name
from ..runs.crash import crash_of_failure
from ..runs.folder import is_done
from ..runs.log import log_of_failure, recorded_log
from ..runs.run import Run
from .outcome import (
    COHORT,
    FAILED,
    PAGE,
    Outcome,
    check_table,
    forget_failure,
    note_failure,
    outcome_of,
    write_table,
)
from .pipeline import Pipeline
from .place import Task
from .scheduler import spread
from .study import Planned
from .supervision import Ended, Limits, watched

SHARE = 0.05  # largest share of the time for writing the table of the cases that are done so far
log = logging.getLogger("o3dls")


def run_into(
    pipeline: Pipeline, case: Case, out: Path, *, force: bool = False, pool: Executor | None = None
) -> Run:
    """Run a pipeline and write its folder; a failure leaves only a log beside it that says why, and a crash
    file for those who look for its cause. `pool`: processes that may help.
    """
    check_free(out, force, "run")
    with log_of_failure(out), crash_of_failure(out, case, pipeline.record()):
        run = pipeline.run(case, pool).written(out, force=force)
    forget_failure(out)
    return run


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

    def results(
        self, tasks: Sequence[Task[Outcome]], out: Path
    ) -> Generator[tuple[Task[Outcome], Outcome | Ended]]:
        """Do the tasks, and yield each with its result, as they end."""
        if self.scheduler:
            return spread(tasks, self.scheduler, self.jobs, self.limits, self.stop, out)
        return watched(tasks, self.jobs, self.limits, self.stop)


def run_cohort(
    study: Sequence[Planned],
    out: Path,
    workers: Workers | None = None,
    *,
    force: bool = False,
    table: bool = True,
    told: Callable[[Outcome], None] | None = None,
) -> list[Outcome]:
    """Run every case of a study into `out/<its name>` and write `out/cohort.csv`.

    A case whose run is there, of the same files, pipeline and version, is skipped; another run of it is
    replaced. A case that fails, or that is ended, does not stop the others, and leaves NAME.failed.json. The
    table is there from the first case on; the page of an earlier batch is removed.

    workers: who does them; by default one process of this machine.
    force: make every case again, and replace the table of other cases too. table: False for a part of a study
    whose parts share a folder: table and page are left alone. told: called with each outcome as it comes.
    Raises InputError before any work where two runs would have one name, or something that is no run, or that
    is read, would be replaced; and where a scheduler or its workers cannot do it.
    """
    _check_names(study, out)
    _check_places(study, out, force)
    if table:
        check_table(out, None if force else [one.name for one in study])
    # parts of a study share a folder, and none of them writes the table
    with sole_writer(out, "another batch") if table else nullcontext():
        if table:
            check_table(out, None if force else [one.name for one in study])  # one may have ended just now
            (out / PAGE).unlink(missing_ok=True)  # the page reports runs that are replaced now
        since = _time_of_files(out) if force else None
        tasks = [_Task(one, out / one.name, since, Path.cwd()) for one in study]
        done = (workers or Workers()).results(tasks, out)
        found = _gather_outcomes(done, out, len(study), _Written(out) if table else None, told)
        if table and found:
            write_table(out, found.values())
    return [found[one.name] for one in study if one.name in found]


def _gather_outcomes(
    done: Generator[tuple[Task[Outcome], Outcome | Ended]],
    out: Path,
    of: int,
    written: _Written | None,
    told: Callable[[Outcome], None] | None,
) -> dict[str, Outcome]:
    """Return the outcomes by name; each is noted, logged and told as it comes."""
    found: dict[str, Outcome] = {}
    with closing(done) as results:
        for task, result in results:
            outcome = Outcome(task.name, [], [], result.reason) if isinstance(result, Ended) else result
            if outcome.error:
                note_failure(outcome, out)
            found[task.name] = outcome
            _log_outcome(outcome, len(found), of)
            if written:
                written(found)
            if told:
                told(outcome)
    return found


def _time_of_files(out: Path) -> float:
    """Return the time that a file gets which is now written into a folder: that of another machine, where it
    keeps the folder.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = temporary_name(out / "batch")
    path.touch()
    try:
        return path.stat().st_mtime
    finally:
        path.unlink()


def _log_outcome(outcome: Outcome, done: int, of: int) -> None:
    for warning in () if outcome.skipped else outcome.warnings:
        log.warning("%s: %s", outcome.case, warning)
    log.info("%d of %d: %s", done, of, outcome)


class _Written:
    """The table of the finished cases is written as often as it takes little of the time."""

    def __init__(self, out: Path) -> None:
        self._out, self._next = out, 0.0

    def __call__(self, found: Mapping[str, Outcome]) -> None:
        begin = perf_counter()
        if begin >= self._next:
            write_table(self._out, found.values())
            end = perf_counter()
            self._next = end + (end - begin) / SHARE


def _check_names(study: Sequence[Planned], out: Path) -> None:
    names: dict[str, Planned] = {}
    for one in study:
        check_name(one.name, one.folder)
        if one.name in names:
            raise InputError(
                f"{one.folder}: two runs are named '{one.name}' and would have one folder; rename the case "
                "folder, or give the rows of a table a column 'name'"
            )
        names[one.name] = one
        if one.name.casefold() in (COHORT, PAGE):
            kind = "table" if one.name.casefold() == COHORT else "page"
            raise InputError(
                f"{one.folder}: '{one.name}' is the name of the batch's {kind}; rename the case folder"
            )
    for one in study:
        if one.name.endswith(FAILED) and one.name.removesuffix(FAILED) in names:
            raise InputError(f"{one.folder}: '{one.name}' is the name of another case's failure; rename it")


def _check_places(study: Sequence[Planned], out: Path, force: bool) -> None:
    """Raise InputError where a run would replace what is no run, or a case, or what holds one."""
    for one in study:
        check_inside(out / one.name, out)
        if force or not (out / one.name / "run.json").is_file():
            check_free(out / one.name, True, "run")
    places = {os.path.realpath(out / one.name): out / one.name for one in study}
    for one in study:
        real = Path(os.path.realpath(one.folder))
        for folder in (real, *real.parents):
            if place := places.get(str(folder)):
                raise InputError(
                    f"{place}: is or holds {one.folder}, which is read, and would be replaced; name another "
                    "folder"
                )


@dataclass(frozen=True, eq=False)
class _Task:
    """A task has one case, what to do with it, and where its run goes.

    since: make it again where its run is older, by the time of files; work: the folder that relative paths
    start from.
    """

    plan: Planned
    out: Path
    since: float | None
    work: Path

    @property
    def name(self) -> str:
        """The name of the run's folder."""
        return self.plan.name

    @property
    def reads(self) -> Path:
        """The case folder."""
        return self.work / self.plan.folder

    def __call__(self) -> Outcome:
        with suppress(OSError):  # another machine may not have it, and then all paths must be absolute
            os.chdir(self.work)
        with recorded_log(logging.WARNING) as warnings:
            try:
                return self._run_or_skip()
            except (O3dlsError, OSError) as error:
                reason = str(error)
            except MemoryError:
                reason = "there was too little memory"
            except Exception as error:  # our own mistake in one case must not cost the others
                traceback.print_exc()
                reason = f"internal error, please report it: {type(error).__name__}: {error}"
            except SystemExit:
                # the process was told to end: the pool would take this for an error of the case and go on
                os._exit(1)
        return Outcome(self.name, [], [], reason, warnings)

    def _run_or_skip(self) -> Outcome:
        case = read_case(self.plan.folder)
        pipeline = self.plan.pipeline.allowed_by(case) if self.plan.trim else self.plan.pipeline
        if not self._too_old() and is_done(self.out, pipeline.record(), case):
            forget_failure(self.out)
            return replace(outcome_of(self.out), skipped=True)
        run_into(pipeline, case, self.out, force=True)
        return outcome_of(self.out)

    def _too_old(self) -> bool:
        record = self.out / "run.json"
        return self.since is not None and not (record.exists() and record.stat().st_mtime > self.since)

    def abandoned(self, process: int | None = None) -> None:
        """Remove what a process that was ended left half made, or any that did."""
        remove_partial(self.work / self.out, process)
