"""Commands of cohorts: batch, which runs many cases, and cohort, which tells of runs that are there."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .interrupts import first_told
from .options import as_json, limits, overrides, progress
from .words import DONE, FILE, FOLDER, INTERRUPTED, NOT_VALID, WRONG_INPUT, complain, say, say_json, say_lines

if TYPE_CHECKING:
    from ..pipeline.outcome import Outcome
    from ..pipeline.scheduler import Workers
    from ..report.cohort.entries import Entry

NO_PLACES: Mapping[str, Path | None] = {"table": None, "page": None}  # of a part of a study


def _read_part(_: click.Context, __: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Read I/N, which means the I-th of N parts."""
    if value is None:
        return None
    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", value)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise click.BadParameter(f"'{value}': must be I/N with I from 1 to N, such as 1/4")
    return int(match[1]), int(match[2])


@click.command()
@click.argument("cases", type=FOLDER, nargs=-1, required=True)
@click.option(
    "--pipeline", type=FILE, help="pipeline file; without one the default pipeline with what each case allows"
)
@click.option(
    "--out",
    type=FOLDER,
    default=Path("runs"),
    show_default=True,
    help="folder for the run folders, cohort.csv and cohort.html",
)
@overrides
@click.option(
    "--jobs", type=click.IntRange(min=1), show_default="1", help="cases that run at one time on this machine"
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="run the cases on the workers of a dask scheduler, tcp://host:port; local: on --jobs workers of "
    "this machine",
)
@click.option(
    "--resume/--force",
    default=True,
    help="skip the cases whose runs are there, of the same files, pipeline and version (the default), or "
    "make them all again",
)
@click.option(
    "--shard",
    callback=_read_part,
    metavar="I/N",
    help="run only the I-th of N parts of the cases, and then `o3dls cohort` for the table and the page",
)
@limits
@click.option(
    "--retries",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="retries of a case whose process was killed",
)
@as_json
@progress
def batch(
    cases: tuple[Path, ...],
    pipeline: Path | None,
    settings: tuple[str, ...],
    out: Path,
    shard: tuple[int, int] | None,
    resume: bool,
    as_json: bool,
    **how: Any,
) -> int:
    """Run many CASES, side by side, and write one table and one page of the cohort.

    CASES are case folders, quoted patterns such as 'cases/*', and tables (.csv): a row for each run, with the
    columns case and, where wanted, pipeline, name and set.STAGE.PARAM. Ctrl-C lets the running cases end, a
    second one ends them; the same command goes on where it was.
    """
    from ..pipeline.study import read_study
    from ..pipeline.study import shard as part_of
    from .environment import check_libraries

    check_libraries()
    study = read_study(cases, pipeline, settings)
    if shard:
        study = part_of(study, *shard)
    workers = _find_workers(**how)
    outcomes = _run_study(study, out, workers, force=not resume, as_json=as_json, table=not shard)
    if len(outcomes) < len(study):
        return INTERRUPTED
    if shard:
        return _report_outcomes(outcomes, as_json=as_json)
    return _report_cohort(outcomes, out, as_json=as_json)


def _find_workers(
    *, jobs: int | None, scheduler: str | None, timeout: float | None, memory: float | None, retries: int
) -> Workers:
    """Return who runs the cases, and within what limits."""
    from ..pipeline.scheduler import LOCAL, Workers
    from ..pipeline.supervision import Limits

    if jobs and scheduler not in (None, LOCAL):
        raise click.UsageError(f"--jobs: {scheduler} has workers of its own; leave --jobs out")
    return Workers(jobs or 1, scheduler, Limits(timeout, int(memory) if memory else None, retries))


def _run_study(
    study: Sequence[Any], out: Path, workers: Workers, *, force: bool, as_json: bool, table: bool
) -> list[Outcome]:
    """Run a study's cases and return their outcomes; each is told as it comes."""
    from ..pipeline.batch import run_cohort
    from .progress import bar

    with bar(len(study)) as shown, first_told(workers.stop.set):
        hear = _make_listener(len(study), shown, as_json)
        return run_cohort(study, out, workers, force=force, table=table, told=hear)


def _make_listener(cases: int, shown: Any, as_json: bool) -> Callable[[Outcome], None]:
    """Make what is called with each outcome as it comes: it prints a line of JSON for programs, and moves the
    bar.
    """
    done = 0

    def hear(outcome: Outcome) -> None:
        nonlocal done
        done += 1
        if as_json:
            _say_outcome(outcome, done, cases)
        if shown:
            shown.count(outcome)
            shown.show()

    return hear


def _say_outcome(outcome: Outcome, done: int, cases: int) -> None:
    from ..runs.record import plain

    say_json({"done": done, "of": cases} | plain(asdict(outcome)), line=True)


@click.command()
@click.argument("runs", type=FOLDER)
@click.option("--mean", metavar="COLUMN", help="value of the points to average over the hearts: bipolar, ...")
@click.option(
    "--on",
    type=click.Path(path_type=Path, exists=True),
    help="left atrium to lay the mean on, a run or a mesh; default: that of middle size",
)
@click.option("--out", type=FILE, help="surface to write, with the mean as fields: .vtp, .vtk, .ply")
@as_json
def cohort(runs: Path, mean: str | None, on: Path | None, out: Path | None, as_json: bool) -> int:
    """Write cohort.csv and cohort.html of the finished runs in the folder RUNS, and of the cases that failed.

    For the parts of a study that were run apart (`o3dls batch --shard`): table and page are as if it had been
    run at once. A table and a page that are there are replaced.

    With --mean print in their place the mean of a value over the hearts of the runs, by segment, and how
    hearts differ; maps are laid on one another by atrial coordinates.
    """
    from ..pipeline.outcome import check_table, gathered, write_table

    outcomes = gathered(runs)
    if mean:
        finished = [runs / one.case for one in outcomes if not one.error]
        return _average_values(finished, mean, on, out, as_json=as_json)
    if on or out:
        raise click.UsageError("--on and --out go with --mean, which names the value to average")
    check_table(runs, None)
    write_table(runs, outcomes)
    if as_json:
        for done, outcome in enumerate(outcomes, 1):
            _say_outcome(outcome, done, len(outcomes))
    return _report_cohort(outcomes, runs, as_json=as_json)


def _average_values(
    runs: Sequence[Path], column: str, on: Path | None, out: Path | None, *, as_json: bool
) -> int:
    """Print the mean of a column over the hearts of runs, and write it as a surface."""
    from ..report.mapping import mean
    from ..runs.folder import check_not_of_a_run

    if out:
        check_not_of_a_run(out)  # before what takes a second for each heart
    found = mean.mean_of(runs, column, on)
    lost = mean.write_mean(out, found) if out else []
    say_lines((mean.as_json if as_json else mean.as_text)(found))
    for sentence in (*found.left_out, *lost):
        complain(sentence)
    return DONE


def _report_cohort(outcomes: Sequence[Outcome], out: Path, *, as_json: bool) -> int:
    """Write the page of a cohort, and print what became of its cases with their grades."""
    from ..pipeline.outcome import COHORT
    from ..report.writer import cohort_entries, write_cohort

    entries = cohort_entries(outcomes, out)
    places = {"table": out / COHORT, "page": write_cohort(outcomes, out, entries)}
    return _report_outcomes(outcomes, places, entries, as_json=as_json)


def _report_outcomes(
    outcomes: Sequence[Outcome],
    places: Mapping[str, Path | None] = NO_PLACES,
    entries: Sequence[Entry] = (),
    *,
    as_json: bool,
) -> int:
    """Print what became of the cases, how their results are graded, and where all stands; return the exit
    code.
    """
    from .summary import record_grades, say_grades

    if as_json:
        failed = sum(one.error is not None for one in outcomes)
        skipped = sum(one.skipped for one in outcomes)
        counts = {"cases": len(outcomes), "failed": failed, "skipped": skipped}
        found = {key: path and str(path) for key, path in places.items()}
        say_json(counts | found | record_grades(entries), line=True)
    else:
        for one in outcomes:
            say(one)
        say_grades(entries)
        for path in filter(None, places.values()):
            say(path)
    if any(outcome.error for outcome in outcomes):
        return WRONG_INPUT
    return NOT_VALID if any(outcome.faults for outcome in outcomes) else DONE
