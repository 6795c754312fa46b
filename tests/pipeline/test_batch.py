"""Many cases at one time: what goes wrong with one does not touch the others, and an interruption ends them
all.
"""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import pytest
from tiny import Nudge, ball_case

from o3dls.case import Case
from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.io.case_writer import write_case
from o3dls.pipeline import outcome
from o3dls.pipeline.batch import run_cohort
from o3dls.pipeline.outcome import Outcome
from o3dls.pipeline.pipeline import Pipeline
from o3dls.pipeline.study import planned
from o3dls.plugins.stage import Stage
from o3dls.report.writer import write_cohort
from o3dls.run_warning import RunWarning
from o3dls.runs.writers import Writer

ENDED = 30.0  # seconds: far more than ending takes, far less than `Slow` works


class Careless(Nudge):
    """Forgets that a case may have few points, and is never sure."""

    name: ClassVar[str] = "careless"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        if len(case.points.of("eam")) < 40:
            raise IndexError("too short")
        return replace(super().__call__(case, start), warnings=(RunWarning("other", "the map is not sure"),))


class Talkative(Nudge):
    """Refuses a case of few points in more than one line."""

    name: ClassVar[str] = "talkative"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        if len(case.points.of("eam")) < 40:
            raise InputError("first line\nsecond\u2028third")
        return super().__call__(case, start)


class Killed(Nudge):
    """Is ended from outside where a case has few points, as by a system that is out of memory."""

    name: ClassVar[str] = "killed"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        if len(case.points.of("eam")) < 40:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__call__(case, start)


class Slow(Stage):
    """Says that it has begun, and works for long."""

    name: ClassVar[str] = "slow"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        print("begun", flush=True)
        time.sleep(300.0)
        return start


class SlowNote(Writer):
    """Says that it has begun, and writes for long."""

    name: ClassVar[str] = "slow_note"

    def __call__(self, run: Any, folder: Path) -> None:
        print("begun", flush=True)
        time.sleep(300.0)


def cases(folder: Path, **points: int) -> list[Path]:
    for name, count in points.items():
        write_case(folder / name, replace(ball_case(count), name=name))
    return [folder / name for name in points]


def run_all(folders: list[Path], pipeline: Pipeline, out: Path, **how: Any) -> list[Outcome]:
    return run_cohort(planned(folders, pipeline), out, **how)


def test_a_mistake_of_ours_in_one_case_costs_no_other(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    outcomes = run_all(cases(tmp_path, few=30, many=60), Pipeline([Careless()], folds=0), tmp_path / "runs")
    assert [outcome.error for outcome in outcomes] == [
        "internal error, please report it: IndexError: too short",
        None,
    ]
    assert (tmp_path / "runs/many/run.json").is_file()
    assert "IndexError" in (tmp_path / "runs/few.failed.log").read_text()
    assert caplog.messages == ["many: the map is not sure"]
    rows = list(csv.DictReader((tmp_path / "runs/cohort.csv").read_text().splitlines()))
    assert {row["case"]: row["warnings"] for row in rows} == {"few": "", "many": "the map is not sure"}


def test_a_process_that_is_ended_from_outside_costs_no_other_case(tmp_path: Path) -> None:
    outcomes = run_all(
        cases(tmp_path, one=60, few=30, two=60), Pipeline([Killed()], folds=0), tmp_path / "runs"
    )
    assert [outcome.case for outcome in outcomes] == ["one", "few", "two"]
    assert [bool(outcome.rows) for outcome in outcomes] == [True, False, True]
    assert "killed from outside" in str(outcomes[1].error)


def test_a_table_of_another_batch_is_only_replaced_when_told(tmp_path: Path) -> None:
    first, second = cases(tmp_path, first=60, second=60)
    pipeline = Pipeline([Nudge()], folds=0)
    out = tmp_path / "runs"
    run_all([first], pipeline, out)
    with pytest.raises(InputError, match=r"cohort\.csv: exists already"):
        run_all([second], pipeline, out)
    assert not (out / "second").exists()
    run_all([second], pipeline, out, force=True)
    assert "second" in (out / "cohort.csv").read_text()


def test_a_page_of_another_batch_is_only_replaced_when_told_and_then_removed_before_the_work(
    tmp_path: Path,
) -> None:
    (folder,) = cases(tmp_path, one=60)
    out = tmp_path / "runs"
    out.mkdir()
    (out / "cohort.html").write_text("of another batch")
    pipeline = Pipeline([Nudge()], folds=0)
    with pytest.raises(InputError, match=r"cohort\.html: exists already"):
        run_all([folder], pipeline, out)
    run_all([folder], pipeline, out, force=True)
    assert sorted(path.name for path in out.iterdir()) == ["cohort.csv", "one"]


def test_the_page_names_what_failed_beside_what_was_run(tmp_path: Path) -> None:
    folders = cases(tmp_path, one=60, few=30, two=70)
    out = tmp_path / "runs"
    outcomes = run_all(folders, Pipeline([Careless()], folds=0), out)
    page = write_cohort(outcomes, out)
    text = page.read_text(encoding="utf-8")
    assert page == out / "cohort.html"
    assert "2 cases, 2 runs compared" in text
    assert "<strong>few</strong>: internal error, please report it: IndexError: too short" in text
    assert sorted(path.name for path in out.iterdir()) == [
        "cohort.csv",
        "cohort.html",
        "few.crash.json",
        "few.failed.json",
        "few.failed.log",
        "one",
        "two",
    ]


def test_a_page_of_failures_alone_is_written_too(tmp_path: Path) -> None:
    outcomes = run_all(cases(tmp_path, few=30), Pipeline([Careless()], folds=0), tmp_path / "runs")
    text = write_cohort(outcomes, tmp_path / "runs").read_text(encoding="utf-8")
    assert "1 case failed" in text
    assert "0 cases, 0 runs compared" in text


def test_the_page_is_there_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "runs"
    outcomes = run_all(cases(tmp_path, one=60), Pipeline([Nudge()], folds=0), out)
    before = sorted(out.rglob("*"))
    written = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", lambda path, data: written(path, data[: len(data) // 2]))
    with pytest.raises(InputError, match=r"cohort\.html: cannot be written: the disk kept"):
        write_cohort(outcomes, out)
    assert sorted(out.rglob("*")) == before


def test_a_line_break_in_a_name_or_an_error_does_not_cost_the_table(tmp_path: Path) -> None:
    folders = cases(tmp_path, **{"one\ntwo": 60, "three": 30})
    run_all(folders, Pipeline([Talkative()], folds=0), tmp_path / "runs")
    with (tmp_path / "runs/cohort.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["case"]: row["error"] for row in rows} == {
        "one\\ntwo": "",
        "three": "first line\\nsecond\\u2028third",
    }


@pytest.mark.parametrize(
    ("name", "what"), [("cohort.csv", "table"), ("Cohort.CSV", "table"), ("Cohort.html", "page")]
)
def test_a_case_with_the_name_of_the_table_or_page_is_refused_before_any_work(
    name: str, what: str, tmp_path: Path
) -> None:
    folders = cases(tmp_path, **{"one": 60, name: 60})
    with pytest.raises(InputError, match=f"'{name}' is the name of the batch's {what}; rename the case"):
        run_all(folders, Pipeline([Nudge()], folds=0), tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("name", ["cohort.csv", "cohort.html"])
def test_a_folder_in_the_place_of_the_table_or_page_is_named_before_any_work(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / "runs" / name).mkdir(parents=True)
    with pytest.raises(InputError, match=f"{name}: is a folder"):
        run_all(cases(tmp_path, one=60), Pipeline([Nudge()], folds=0), tmp_path / "runs", force=True)
    assert not (tmp_path / "runs/one").exists()


def test_the_table_holds_the_cases_that_are_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    written = outcome.write_rows

    def spied(path: Path, rows: Any) -> None:
        written(path, rows)
        seen.append([row["case"] for row in csv.DictReader(path.read_text().splitlines())])

    monkeypatch.setattr(outcome, "write_rows", spied)
    run_all(cases(tmp_path, one=60, two=60), Pipeline([Nudge()], folds=0), tmp_path / "runs")
    assert [sorted(set(names)) for names in (seen[0], seen[-1])] == [["one"], ["one", "two"]]


def test_a_batch_never_replaces_its_cases(tmp_path: Path) -> None:
    folders = cases(tmp_path, one=60, two=60)
    (folders[1] / "run.json").write_text("{}")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match="one: is not a run, so o3dls does not replace it"):
        run_all(folders, Pipeline([Nudge()], folds=0), tmp_path, force=True)
    assert sorted(tmp_path.rglob("*")) == before


BATCH = """
import signal, sys
from pathlib import Path
from test_batch import Slow
from o3dls.pipeline.batch import run_cohort
from o3dls.pipeline.pipeline import Pipeline
from o3dls.pipeline.study import planned
signal.signal(signal.SIGINT, signal.default_int_handler)
run_cohort(planned(map(Path, sys.argv[2:]), Pipeline([Slow()], folds=0)), Path(sys.argv[1]))
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_batch_ends_with_its_processes(how: signal.Signals, tmp_path: Path) -> None:
    command = [sys.executable, "-c", BATCH, tmp_path / "runs", *cases(tmp_path, one=60, two=60)]
    with subprocess.Popen(
        command, cwd=Path(__file__).parent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        process.send_signal(how)
        # nothing else began, and nobody holds the pipe any more
        assert process.communicate(timeout=ENDED)[0] == ""


TERMINATED = """
import sys
from importlib.metadata import EntryPoint
from o3dls.plugins import plugin
known = plugin.registered
slow = EntryPoint("slow_note", "test_batch:SlowNote", "o3dls.writers")
plugin.registered = lambda group: known(group) | ({"slow_note": slow} if group == "o3dls.writers" else {})
from o3dls.cli.main import main
main()
"""


def test_a_run_that_is_told_to_end_removes_what_it_has_half_written(tmp_path: Path) -> None:
    (tmp_path / "pipe.toml").write_text('folds = 0\n[[stage]]\nuse = "icp"\n[[write]]\nuse = "slow_note"\n')
    (out := tmp_path / "out").mkdir()
    command = [
        sys.executable,
        "-c",
        TERMINATED,
        "run",
        tmp_path / "pipe.toml",
        "--case",
        *cases(tmp_path, one=60),
        "--out",
        out / "run",
    ]
    with subprocess.Popen(
        command, cwd=Path(__file__).parent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        process.terminate()
        assert "interrupted" in process.communicate(timeout=ENDED)[1]
    assert process.returncode == 143
    assert [path.name for path in out.iterdir()] == ["run.failed.log"]


def test_a_folder_whose_name_is_no_text_is_a_case_too(tmp_path: Path) -> None:
    (tmp_path / "pipe.toml").write_text('folds = 0\n[[stage]]\nuse = "icp"\n')
    folder = os.fsdecode(b"F\xfcr")
    write_case(tmp_path / folder, ball_case())
    command = [sys.executable, "-m", "o3dls", "batch", folder, "--pipeline", "pipe.toml"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, env=os.environ | {"PYTHONIOENCODING": "utf-8:strict"}
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"F\xfcr: done")


def test_two_batches_at_one_time_do_not_share_a_folder(tmp_path: Path) -> None:
    """Both used to end well, and the table had the cases of one."""
    first, second = cases(tmp_path, first=60, second=60)
    pipeline, out = Pipeline([Nudge()], folds=0), tmp_path / "runs"

    def begin_another(outcome: Outcome) -> None:
        with pytest.raises(InputError, match="another batch writes there at this time"):
            run_all([second], pipeline, out, force=True)

    run_all([first], pipeline, out, told=begin_another)
    assert sorted(path.name for path in out.iterdir()) == ["cohort.csv", "first"]
    run_all([second], pipeline, out, force=True)
    assert (out / "second/run.json").is_file()


def test_parts_of_a_study_share_a_folder_at_one_time(tmp_path: Path) -> None:
    first, second = cases(tmp_path, first=60, second=60)
    pipeline, out = Pipeline([Nudge()], folds=0), tmp_path / "runs"
    run_all(
        [first],
        pipeline,
        out,
        table=False,
        told=lambda _: run_all([second], pipeline, out, table=False) and None,
    )
    assert all((out / name / "run.json").is_file() for name in ("first", "second"))
