"""A cohort on machines that fail: no case is lost or done twice, limits end what they should, and the table
is the same however it was computed: by one process, some, or workers of dask. O3DLS_COHORT=1000 makes the
cohort so large.
"""

from __future__ import annotations

import csv
import json
import mmap
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from typing import Any, ClassVar

import numpy as np
import pytest
from pydantic import Field
from tiny import Nudge, ball_case

from data_synth import star
from o3dls.case import Case
from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.io.case_writer import write_case
from o3dls.pipeline.batch import Workers, run_cohort
from o3dls.pipeline.outcome import Outcome, gathered, write_table
from o3dls.pipeline.pipeline import Pipeline
from o3dls.pipeline.study import planned, read_study, shard
from o3dls.pipeline.supervision import Limits, resident
from o3dls.report.writer import write_cohort
from o3dls.runs.writers import Writer
from o3dls.stages.icp import ICP

CASES = int(os.environ.get("O3DLS_COHORT", "24"))
SHARDS = max(4, CASES // 25)
SEED = 702_344
ENDED = 5.0  # seconds after the limit by which a case must have ended
MEMORY = 900_000_000  # bytes: what the libraries take, and half as much again
PIPELINE = 'folds = 0\n[[stage]]\nuse = "icp"\n'
QUICK = Pipeline([ICP()], folds=0)


class Heavy(Nudge):
    """Takes all the memory that it is given where a case has few points; writes when it passes the limit."""

    name: ClassVar[str] = "heavy"
    mark: str = Field("", description="file for the moment, on the clock that all processes have")

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        if len(case.points.of("eam")) < 40:
            held = []
            while resident(os.getpid()) <= MEMORY:
                Path(self.mark).write_text(str(time.monotonic()))
                held.append(np.ones(4_000_000))  # 32 MB that are used, and not reserved alone
                time.sleep(0.02)
            time.sleep(300.0)
        return super().__call__(case, start)


class SlowNote(Writer):
    """Writes half a file, and then for ever, where a case has few points; deaf to what would end it."""

    name: ClassVar[str] = "slow_note"

    def __call__(self, run: Any, folder: Path) -> None:
        if len(run.case.points.of("eam")) < 40:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            (folder / "half").write_text("half")
            time.sleep(300.0)


class Long(Writer):
    """Says that it has begun, and writes for some seconds."""

    name: ClassVar[str] = "long"

    def __call__(self, run: Any, folder: Path) -> None:
        print("begun", flush=True)
        (folder / "half").write_text("half")
        time.sleep(4.0)


class Mortal(Nudge):
    """Is killed in its first process, where a case has few points: with a run that another left."""

    name: ClassVar[str] = "mortal"
    marks: str = ""

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        mark = Path(self.marks) / case.name
        if len(case.points.of("eam")) < 40 and not mark.exists():
            mark.write_text("died once")
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__call__(case, start)


def cases(folder: Path, **points: int) -> list[Path]:
    for name, count in points.items():
        write_case(folder / name, replace(ball_case(count), name=name))
    return [folder / name for name in points]


def many(folder: Path, count: int) -> list[Path]:
    """So many small cases of data_synth, each of another seed, and one that cannot be read."""
    (folder / "broken").mkdir(parents=True)
    for k in range(count):
        write_case(folder / f"c{k:04d}", replace(star(seed=SEED + k), name=f"c{k:04d}"))
    return [folder / "broken", *(folder / f"c{k:04d}" for k in range(count))]


def table(out: Path) -> str:
    return (out / "cohort.csv").read_text(encoding="utf-8")


def errors(out: Path) -> dict[str, str]:
    return {row["case"]: row["error"] for row in csv.DictReader(table(out).splitlines())}


def whole(out: Path) -> None:
    """No file or folder is left that has a temporary name."""
    assert not [path.name for path in out.iterdir() if path.name.startswith(".")]


@pytest.fixture(scope="module")
def cohort(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Path]:
    """Cases, and the folder of their runs by one process."""
    folder = tmp_path_factory.mktemp("cohort")
    folders = many(folder / "cases", CASES)
    run_cohort(planned(folders, QUICK), folder / "runs")
    return folders, folder / "runs"


def children(process: int) -> list[int]:
    """The processes that a process began, with what keeps track of their resources."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == process:
            found.append(int(stat.parent.name))
    return found


def killed(stop: Event, told: list[Outcome], dead: list[int]) -> None:
    """Kill a process at work some times, each after another case has ended: so all come to an end."""
    rng = random.Random(SEED)
    ended = 0
    while len(dead) < max(3, CASES // 20) and not stop.wait(rng.uniform(0.0, 0.2)):
        at_work = spawned(os.getpid())
        at_work += [process for worker in at_work for process in spawned(worker)]
        if len(told) > ended and at_work:
            ended = len(told)
            victim = rng.choice(at_work)
            with suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)
                dead.append(victim)


def spawned(process: int) -> list[int]:
    """The processes for cases, or for workers, that a process began."""
    found = []
    for child in children(process):
        with suppress(OSError):
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(child)
    return found


ENGINES = pytest.mark.parametrize("scheduler", [None, "local"])


@pytest.mark.skipif(sys.platform != "linux", reason="finds the processes in /proc")
@ENGINES
def test_processes_that_are_killed_at_random_lose_no_case_and_change_no_number(
    scheduler: str | None, cohort: tuple[list[Path], Path], tmp_path: Path
) -> None:
    if scheduler:
        pytest.importorskip("distributed")
    folders, alone = cohort
    stop, dead, told = Event(), list[int](), list[Outcome]()
    killer = Thread(target=killed, args=(stop, told, dead))
    killer.start()
    try:
        workers = Workers(2, scheduler, Limits(retries=100))
        run_cohort(planned(folders, QUICK), tmp_path / "runs", workers, told=told.append)
    finally:
        stop.set()
        killer.join()
    assert dead
    assert Counter(one.case for one in told) == Counter(folder.name for folder in folders)
    assert table(tmp_path / "runs") == table(alone)
    whole(tmp_path / "runs")


def test_a_process_that_dies_once_is_replaced_and_the_dead_are_counted(tmp_path: Path) -> None:
    folders = cases(tmp_path / "cases", one=60, few=30)
    (tmp_path / "marks").mkdir()
    pipeline = Pipeline([Mortal(marks=str(tmp_path / "marks"))], folds=0)
    workers = Workers(limits=Limits(retries=0))
    outcomes = run_cohort(planned(folders, pipeline), tmp_path / "runs", workers)
    # `few` died in a process that had done `one`, which may be to blame
    assert [outcome.error for outcome in outcomes] == [None, None]
    (tmp_path / "marks/few").unlink()
    outcomes = run_cohort(planned(folders[1:], pipeline), tmp_path / "again", workers)
    assert outcomes[0].error == "its process was killed from outside, once; is there too little memory?"


BATCH = """
import sys
from pathlib import Path
from test_cohorts import QUICK, Workers, planned, run_cohort
if __name__ == "__main__":
    folders = sorted(Path(sys.argv[2]).iterdir())
    run_cohort(planned(folders, QUICK), Path(sys.argv[1]), Workers(2, sys.argv[3] or None))
"""


@ENGINES
def test_a_batch_that_was_killed_goes_on_where_it_was(
    scheduler: str | None, cohort: tuple[list[Path], Path], tmp_path: Path
) -> None:
    if scheduler:
        pytest.importorskip("distributed")
    folders, alone = cohort
    out = tmp_path / "runs"
    command = [sys.executable, "-c", BATCH, out, folders[0].parent, scheduler or ""]
    here = Path(__file__).parent
    paths = [str(here), *filter(None, [os.environ.get("PYTHONPATH")])]
    around = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}  # a safe path has no folder
    with subprocess.Popen(command, cwd=here, env=around) as process:
        while len(list(out.glob("c*/run.json"))) < CASES // 4:
            assert process.poll() is None
            time.sleep(0.02)
        process.kill()
    time.sleep(5.0)  # its processes have two seconds to end, and workers of dask hear of it first
    before = {path: path.stat().st_ino for path in out.glob("c*/run.json")}
    outcomes = run_cohort(planned(folders, QUICK), out)
    assert [one.case for one in outcomes if one.skipped] == sorted(path.parent.name for path in before)
    assert all(path.stat().st_ino == inode for path, inode in before.items())
    assert table(out) == table(alone)
    again = run_cohort(planned(folders, QUICK), out)
    assert [one.skipped for one in again] == [one.case != "broken" for one in again]
    assert table(out) == table(alone)
    assert "skipped" in str(again[1])
    assert "skipped" not in str(again[0])


def test_shards_that_are_gathered_give_the_table_and_page_of_one_batch(
    cohort: tuple[list[Path], Path], tmp_path: Path
) -> None:
    folders, alone = cohort
    out = tmp_path / alone.name
    study = planned(folders, QUICK)
    parts = [shard(study[::-1], k, SHARDS) for k in range(1, SHARDS + 1)]
    assert sorted(one.name for part in parts for one in part) == sorted(one.name for one in study)
    for part in parts:
        run_cohort(part, out, table=False)
    assert not (out / "cohort.csv").exists()
    outcomes = gathered(out)
    write_table(out, outcomes)
    assert table(out) == table(alone)
    page = write_cohort(outcomes, out).read_text(encoding="utf-8")
    assert f"{CASES} runs compared" in page
    assert "<strong>broken</strong>: " in page


@pytest.mark.parametrize("what", ["files", "pipeline", "version", "damage", "force"])
def test_a_case_is_done_only_by_a_whole_run_of_the_same_files_pipeline_and_version(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from o3dls.pipeline.batch import _Task, _time_of_files

    (folder,) = cases(tmp_path / "cases", one=60)
    out, plan = tmp_path / "one", QUICK
    assert _Task(planned([folder], QUICK)[0], out, None, tmp_path)().error is None
    assert _Task(planned([folder], QUICK)[0], out, None, tmp_path)().skipped
    if what == "files":
        write_case(folder, replace(ball_case(61), name="one"), force=True)
    elif what == "pipeline":
        plan = Pipeline([ICP(tolerance=0.5)], folds=0)
    elif what == "version":
        record = json.loads((out / "run.json").read_text())
        record["versions"]["o3dls"] = "0.0.1"
        (out / "run.json").write_text(json.dumps(record))
    elif what == "damage":
        (out / "estimates/icp/surface.ply").unlink()
    since = _time_of_files(tmp_path) if what == "force" else None
    outcome = _Task(planned([folder], plan)[0], out, since, tmp_path)()
    assert (outcome.error, outcome.skipped) == (None, False)
    # also where it was to be made again: the process, or worker, may have been lost after it was done
    assert _Task(planned([folder], plan)[0], out, since, tmp_path)().skipped


def timed(tasks: Any, out: Path, workers: Workers) -> Iterator[tuple[Outcome, float]]:
    ends: list[tuple[Outcome, float]] = []
    run_cohort(tasks, out, workers, told=lambda one: ends.append((one, time.monotonic())))
    return iter(ends)


def test_a_case_beyond_its_time_is_ended_and_leaves_nothing_half_written(tmp_path: Path) -> None:
    limit = 12.0  # far more than a quick case takes, also on a busy machine
    folders = cases(tmp_path / "cases", one=60, few=30, two=60)
    study = planned(folders, Pipeline([Nudge()], [SlowNote()], folds=0))
    ended = timed(study, tmp_path / "runs", Workers(limits=Limits(seconds=limit)))
    (one, before), (few, after), (two, _) = ended
    assert (one.error, two.error) == (None, None)
    assert few.error == "took more than 12 s and was stopped (--timeout)"
    assert limit <= after - before < limit + ENDED
    whole(tmp_path / "runs")
    assert not (tmp_path / "runs/few").exists()
    assert errors(tmp_path / "runs")["few"] == few.error
    assert [one.error for one in gathered(tmp_path / "runs")] == [few.error, None, None]


def test_a_case_beyond_its_memory_is_ended(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    folders = cases(tmp_path / "cases", few=30, one=60)
    study = planned(folders, Pipeline([Heavy(mark=str(mark))], folds=0))
    (few, ended), (one, _) = timed(study, tmp_path / "runs", Workers(limits=Limits(120.0, MEMORY)))
    assert few.error == "took more than 900 MB of memory and was stopped (--memory)"
    assert one.error is None
    assert 0.0 < ended - float(mark.read_text()) < ENDED
    whole(tmp_path / "runs")


def test_the_memory_of_a_process_is_what_it_uses(monkeypatch: pytest.MonkeyPatch) -> None:
    before = resident(os.getpid())
    # a mapping of its own: an array may get memory that was freed before and that the process still has
    held = np.frombuffer(mmap.mmap(-1, 80_000_000), np.uint8)
    held[:] = 1
    assert resident(os.getpid()) - before > 0.9 * held.nbytes
    monkeypatch.setattr("o3dls.pipeline.supervision.resident", lambda _: 0)
    with pytest.raises(InputError, match="does not say what memory"):
        Limits(memory=1)


def test_a_failure_is_forgotten_once_there_is_a_run(tmp_path: Path) -> None:
    (folder,) = cases(tmp_path / "cases", one=60)
    points = (folder / "points.csv").read_text()
    (folder / "points.csv").unlink()
    out = tmp_path / "runs"
    assert run_cohort(planned([folder], QUICK), out)[0].error
    assert json.loads((out / "one.failed.json").read_text())["case"] == "one"
    (folder / "points.csv").write_text(points)
    assert not run_cohort(planned([folder], QUICK), out)[0].error
    assert not list(out.glob("one.failed*"))


def test_once_told_to_stop_what_runs_ends_and_nothing_more_is_begun(tmp_path: Path) -> None:
    folders = cases(tmp_path / "cases", one=60, two=60, three=60)
    workers = Workers()
    out = tmp_path / "runs"
    outcomes = run_cohort(planned(folders, QUICK), out, workers, told=lambda _: workers.stop.set())
    assert [one.case for one in outcomes] == ["one"]
    assert set(errors(tmp_path / "runs")) == {"one"}


INTERRUPTED = """
import signal
from importlib.metadata import EntryPoint
from o3dls.plugins import plugin
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
known = plugin.registered
long = EntryPoint("long", "test_cohorts:Long", "o3dls.writers")
plugin.registered = lambda group: known(group) | ({"long": long} if group == "o3dls.writers" else {})
from o3dls.cli.main import main
main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no groups of processes that get a signal")
@pytest.mark.parametrize("times", [1, 2])
@ENGINES
def test_ctrl_c_lets_the_running_case_end_and_a_second_one_ends_it(
    scheduler: str | None, times: int, tmp_path: Path
) -> None:
    if scheduler:
        pytest.importorskip("distributed")
    cases(tmp_path, one=60, two=60)
    (tmp_path / "pipe.toml").write_text(PIPELINE + '[[write]]\nuse = "long"\n')
    command = [sys.executable, "-c", INTERRUPTED, "batch", "one", "two", "--pipeline", "pipe.toml"]
    command += ["--scheduler", scheduler] if scheduler else []
    path = os.pathsep.join(filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]))
    with subprocess.Popen(
        command,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        for _ in range(times):
            os.killpg(process.pid, signal.SIGINT)
            time.sleep(0.5)  # a second signal that comes before the first was heard is none
        error = process.communicate(timeout=60.0)[1]
    assert process.returncode == 130, error
    assert ("stopping: what runs ends" if scheduler else "stopping: 1 running end, 1 are not begun") in error
    assert error.endswith("o3dls: interrupted\n")
    left = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert left == (["cohort.csv", "one"] if times == 1 else ["one.failed.log"])


def test_a_table_gives_each_row_its_pipeline_and_settings(tmp_path: Path) -> None:
    cases(tmp_path / "cases", one=60, two=60)
    (tmp_path / "quick.toml").write_text(PIPELINE)
    (tmp_path / "study.csv").write_text(
        "case,pipeline,set.icp.tolerance,name\n"
        "cases/one,quick.toml,,\n"
        "cases/one,quick.toml,0.125,rough\n"
        "cases/two,,,\n"
    )
    study = read_study([tmp_path / "study.csv"])
    assert [(one.name, one.folder.name, one.trim) for one in study] == [
        ("one-quick", "one", False),
        ("rough", "one", False),
        ("two", "two", True),
    ]
    assert [one.pipeline.record()["stage"][0]["tolerance"] for one in study[:2]] == [0.005, 0.125]
    assert len(study[2].pipeline.stages) > 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "case,pipline\ncases/one,quick.toml\n",
            "column 'pipline': no such column: did you mean 'pipeline'?",
        ),
        ("case,name\n,a\n", "line 2, column 'case': is empty"),
        ("case,name\ncases/one,../a\n", "must be the name of a folder"),
        ("case,pipeline\ncases/one,none.toml\n", "line 2: .*none.toml"),
        ("case,pipeline,set.icp.keep\ncases/one,quick.toml,2\n", "line 2: .*icp.keep"),
        ("name\na\n", "no column 'case'"),
    ],
)
def test_a_mistake_in_a_table_is_named_with_its_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "quick.toml").write_text(PIPELINE)
    (tmp_path / "study.csv").write_text(text)
    with pytest.raises(InputError, match=rf"study\.csv: {said}|study\.csv.*{said}"):
        read_study([tmp_path / "study.csv"])


def test_a_pattern_names_folders_and_never_none(tmp_path: Path) -> None:
    cases(tmp_path, a1=60, a2=60)
    (tmp_path / "a3.txt").write_text("no folder")
    assert [one.name for one in read_study([tmp_path / "a*"])] == ["a1", "a2"]
    with pytest.raises(InputError, match="no folder has such a name"):
        read_study([tmp_path / "b*"])


def test_two_runs_of_one_name_are_refused_before_any_work(tmp_path: Path) -> None:
    (folder,) = cases(tmp_path, one=60)
    with pytest.raises(InputError, match=r"two runs are named 'one'.*a column 'name'"):
        run_cohort(planned([folder, folder], QUICK), tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("place", ["cases", "cases/one"])
def test_a_run_never_replaces_a_case_that_is_read(place: str, tmp_path: Path) -> None:
    folders = cases(tmp_path / "cases", one=60)
    out = tmp_path if place == "cases" else tmp_path / "cases"
    (tmp_path / place / "run.json").write_text("{}")
    with pytest.raises(InputError, match=r"is or holds .*, which is read, and would be replaced"):
        run_cohort([replace(one, name=Path(place).name) for one in planned(folders, QUICK)], out)


def test_a_folder_without_runs_is_no_cohort(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no runs"):
        gathered(tmp_path)
    with pytest.raises(InputError, match="is not a folder"):
        gathered(tmp_path / "none")
