"""A batch on the workers of a scheduler: with real ones, in processes of their own on this machine."""

from __future__ import annotations

import logging
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from threading import Thread, Timer
from typing import Any

import pytest
from conftest import ROOT
from said import said_by
from test_cohorts import ENDED, MEMORY, PIPELINE, QUICK, Heavy, SlowNote, cases, many, table, timed, whole
from test_readme import BLOCK
from tiny import Nudge, disc_case

from o3dls.errors import InputError
from o3dls.io.case_writer import write_case
from o3dls.io.documents import read_json
from o3dls.pipeline.batch import run_cohort
from o3dls.pipeline.on_worker import Order, done_here, ordered
from o3dls.pipeline.pipeline import Pipeline
from o3dls.pipeline.scheduler import Workers, client_of
from o3dls.pipeline.study import planned
from o3dls.pipeline.supervision import Limits

pytest.importorskip("distributed", reason="extra cluster")

STARTED = 240.0  # seconds: far more than a scheduler and its workers take, also on a busy machine


def dask(*arguments: Any, **how: Any) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "dask", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True, **how)


def until(true: Callable[[], Any]) -> Any:
    end = time.monotonic() + STARTED
    while not (found := true()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return found


def ended(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of a scheduler, and its process."""
    file = tmp_path / "scheduler.json"
    where = ["--host", "127.0.0.1", "--port", 0, "--scheduler-file", file]
    process = dask("scheduler", "--no-dashboard", *where, cwd=Path(__file__).parent)
    try:
        until(lambda: file.is_file() and file.read_text().endswith("}"))
        yield read_json(file)["address"], process
    finally:
        ended(process)


def worker(address: str, *options: str, **how: Any) -> subprocess.Popen[str]:
    how.setdefault("cwd", Path(__file__).parent)  # whose modules it finds
    return dask("worker", address, "--nthreads", 1, "--host", "127.0.0.1", "--no-dashboard", *options, **how)


def test_a_worker_that_is_killed_in_the_middle_costs_nothing(
    scheduler: tuple[str, subprocess.Popen[str]], tmp_path: Path
) -> None:
    many(tmp_path / "cases", 8)
    (tmp_path / "pipe.toml").write_text(PIPELINE)
    batch = [sys.executable, "-m", "o3dls", "batch", "cases/*", "--pipeline", "pipe.toml", "--out"]
    workers = [worker(scheduler[0], "--no-nanny", cwd="/"), worker(scheduler[0], cwd="/")]
    try:
        with subprocess.Popen([*batch, "runs", "--scheduler", scheduler[0]], cwd=tmp_path) as client:
            before = until(lambda: list((tmp_path / "runs").glob("c*/run.json")))
            inodes = {path: path.stat().st_ino for path in before}
            workers[0].kill()
            assert client.wait(STARTED) == 2  # one cannot be read
    finally:
        for process in workers:
            ended(process)
    assert all(path.stat().st_ino == inode for path, inode in inodes.items())  # none was done twice
    whole(tmp_path / "runs")
    assert (tmp_path / "runs/cohort.html").is_file()
    assert read_json(tmp_path / "runs/c0007/run.json")["threads"]["NUMBA_NUM_THREADS"] == "1"
    assert subprocess.run([*batch, "alone"], cwd=tmp_path).returncode == 2
    assert table(tmp_path / "runs") == table(tmp_path / "alone")


def test_what_a_lost_worker_and_its_process_left_is_removed(tmp_path: Path) -> None:
    """Both are killed where a queue takes the machine away: who does the case then cleans up."""
    folders = cases(tmp_path / "cases", batch=60)
    (tmp_path / "runs/.batch.partial-1f-lost/half").mkdir(parents=True)
    (outcome,) = run_cohort(planned(folders, QUICK), tmp_path / "runs", Workers(scheduler="local"))
    assert outcome.error is None
    whole(tmp_path / "runs")


def test_a_lost_scheduler_ends_the_batch_with_a_sentence_and_what_is_done_is_kept(
    scheduler: tuple[str, subprocess.Popen[str]], tmp_path: Path
) -> None:
    folders = cases(tmp_path / "cases", one=60, few=30)
    study = planned(folders, Pipeline([Nudge()], [SlowNote()], folds=0))
    only = worker(scheduler[0])
    workers = Workers(scheduler=scheduler[0])
    try:
        with pytest.raises(InputError, match=r"scheduler was lost.*what is done is kept"):
            run_cohort(study, tmp_path / "runs", workers, told=lambda _: ended(scheduler[1]))
    finally:
        only.terminate()
        only.wait()
    assert (tmp_path / "runs/one/run.json").is_file()
    assert "one" in table(tmp_path / "runs")


def test_without_workers_the_batch_says_so_and_can_be_stopped(
    scheduler: tuple[str, subprocess.Popen[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr("o3dls.pipeline.scheduler.QUIET", 0.5)
    study = planned(cases(tmp_path / "cases", one=60, two=60), QUICK)
    workers = Workers(scheduler=scheduler[0])
    Timer(3.0, workers.stop.set).start()
    with caplog.at_level(logging.INFO, "o3dls"):
        assert run_cohort(study, tmp_path / "runs", workers) == []
    assert "the scheduler has no worker: 2 cases wait for one" in caplog.messages
    assert "stopping: what runs ends, and no more is begun; once more ends it at once" in caplog.messages
    whole(tmp_path / "runs")


def test_a_case_on_a_worker_has_its_limit_of_time(tmp_path: Path) -> None:
    limit = 20.0  # far more than a quick case takes, also on a busy machine
    folders = cases(tmp_path / "cases", one=60, few=30)
    study = planned(folders, Pipeline([Nudge()], [SlowNote()], folds=0))
    workers = Workers(scheduler="local", limits=Limits(seconds=limit))
    (one, before), (few, after) = timed(study, tmp_path / "runs", workers)
    assert one.error is None
    assert few.error == "took more than 20 s and was stopped (--timeout)"
    assert after - before < limit + ENDED
    whole(tmp_path / "runs")


def test_a_case_on_a_worker_has_its_limit_of_memory(tmp_path: Path) -> None:
    folders = cases(tmp_path / "cases", one=60, few=30)
    mark = tmp_path / "mark"
    study = planned(folders, Pipeline([Heavy(mark=str(mark))], folds=0))
    limits = Limits(120.0, MEMORY)
    (one, _), (few, ended) = timed(study, tmp_path / "runs", Workers(scheduler="local", limits=limits))
    assert one.error is None
    assert few.error == "took more than 900 MB of memory and was stopped (--memory)"
    assert 0.0 < ended - float(mark.read_text()) < ENDED
    whole(tmp_path / "runs")


def said(server: socket.socket, what: bytes) -> None:
    with server.accept()[0] as line:
        line.sendall(what)
        line.recv(1000)  # until the other closes it


@pytest.mark.parametrize("says", [None, b"", b"SSH-2.0-OpenSSH"])
def test_where_no_scheduler_answers_it_is_said_within_seconds(says: bytes | None, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        if says is None:
            other.close()
        else:
            Thread(target=said, args=(other, says)).start()
        began = time.monotonic()
        with pytest.raises(InputError, match=f"no scheduler answers at {address}.*`dask scheduler`"):
            run_cohort(planned(cases(tmp_path, one=60), QUICK), tmp_path / "runs", Workers(scheduler=address))
    assert time.monotonic() - began < 20.0  # it has 5 seconds; a busy machine takes some more
    assert not list((tmp_path / "runs").glob("*"))


def test_what_is_no_address_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'lokal': must be local, or the address of a scheduler"):
        run_cohort(planned(cases(tmp_path, one=60), QUICK), tmp_path / "runs", Workers(scheduler="lokal"))


def test_a_scheduler_is_begun_and_has_its_own_workers(
    scheduler: tuple[str, subprocess.Popen[str]], tmp_path: Path
) -> None:
    """What the refusals of `batch` ask for, one after the other."""
    (case,) = cases(tmp_path / "cases", one=60)
    (tmp_path / "pipe.toml").write_text('folds = 0\n[[stage]]\nuse = "icp"\n')
    batch = ("batch", case, "--pipeline", tmp_path / "pipe.toml", "--out", tmp_path / "runs", "--scheduler")
    code, told = said_by(*batch, "lokal")
    found = re.search(r"must be local, or the address of a scheduler, such as (\w+)://host:\d+", told)
    assert found, told
    with socket.create_server(("127.0.0.1", 0)) as other:
        nobody = f"{found[1]}://127.0.0.1:{other.getsockname()[1]}"
    code, told = said_by(*batch, nobody)
    assert "begin one with `dask scheduler`, which says its address" in told
    assert scheduler[0].startswith(f"{found[1]}://")
    code, told = said_by(*batch, scheduler[0], "--jobs", 2)
    assert (code, "has workers of its own; leave --jobs out" in told) == (2, True)
    process = worker(scheduler[0])
    try:
        code, told = said_by(*batch, scheduler[0])
    finally:
        ended(process)
    assert code == 0, told
    assert (tmp_path / "runs/one/run.json").is_file()


def test_without_dask_it_is_said_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"not installed: pip install 'o3dls\[cluster\]'"):
        run_cohort(planned(cases(tmp_path, one=60), QUICK), tmp_path / "runs", Workers(scheduler="local"))


def test_a_machine_that_does_not_see_the_folders_or_has_another_version_says_so(tmp_path: Path) -> None:
    (case,) = cases(tmp_path / "cases", one=60)
    with ordered(tmp_path / "runs") as order:
        assert order.fault(case) is None
        assert str(order.fault(tmp_path / "none")).startswith(f"does not see the case {tmp_path / 'none'};")
        assert "and this is 0.0.1; install the same" in str(Order(order.path, "0.0.1").fault())
    assert str(order.fault(case)).startswith(f"does not see {tmp_path / 'runs'}, where the runs shall go;")


def test_a_worker_that_cannot_do_the_cases_is_named_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = planned(cases(tmp_path / "cases", one=60), QUICK)
    with monkeypatch.context() as other:
        other.setattr("o3dls.pipeline.on_worker.version_of", lambda _: "0.0.1")
        with pytest.raises(InputError, match=r"worker tcp://127.0.0.1:\d+: has o3dls .* and this is 0.0.1"):
            run_cohort(study, tmp_path / "runs", Workers(scheduler="local"))
    # one that joins later hears of it with its first case
    with client_of("local", 1) as client:
        lost = Order(tmp_path / "none/order", None)
        with pytest.raises(InputError, match=r"worker tcp://127.0.0.1:\d+: does not see .*none, where"):
            client.submit(done_here, None, Limits(), lost, None).result()
    assert not (tmp_path / "runs/one").exists()


def test_workers_of_our_own_leave_the_environment_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """dask sets variables for its workers in this process, also when it begins one again."""
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    before = dict(os.environ)
    with client_of("local", 1) as client:
        (address,) = client.nthreads()
        (process,) = client.run(os.getpid).values()
        os.kill(process, signal.SIGKILL)
        until(lambda: client.nthreads() and address not in client.nthreads())
    assert dict(os.environ) == before


def test_a_scheduler_that_lacks_a_module_is_said_in_a_line(
    scheduler: tuple[str, subprocess.Popen[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plugin's stage of which only this machine has the module; dask wraps what the import raises."""
    (tmp_path / "only_here.py").write_text("from tiny import Nudge\n\n\nclass Lone(Nudge):\n    pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    study = planned(cases(tmp_path / "cases", one=60), Pipeline([import_module("only_here").Lone()], folds=0))
    with pytest.raises(
        InputError, match=r"ModuleNotFoundError: No module named 'only_here'; install"
    ) as said:
        run_cohort(study, tmp_path / "runs", Workers(scheduler=scheduler[0]))
    assert "\n" not in str(said.value)


def scripts() -> dict[str, str]:
    """The scripts of the page by what they are for, and whether they are spared."""
    page = (ROOT / "docs/cohorts.md").read_text(encoding="utf-8")
    return {
        block["code"]: block["spared"] or ""
        for block in BLOCK.finditer(page)
        if block["language"] == "python"
    }


def test_the_page_has_a_script_for_every_kind_of_cluster() -> None:
    for code in scripts():
        compile(code, "cohorts.md", "exec")
    names = ("LocalCluster", "SSHCluster", "SLURMCluster", "PBSCluster", "SGECluster")
    assert [name for code in scripts() for name in names if f"import {name}" in code] == list(names)


def test_the_script_for_this_machine_runs(tmp_path: Path) -> None:
    (code,) = (code for code, spared in scripts().items() if not spared)
    write_case(tmp_path / "cases/disc", replace(disc_case(), name="disc"))
    (tmp_path / "quick.toml").write_text(PIPELINE)
    quick = code.replace('"cases/*"', '"cases/*", "--pipeline", "quick.toml"')
    (tmp_path / "script.py").write_text(quick)
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True)
    assert "1 of 1: disc" in done.stderr
    assert "disc" in table(tmp_path / "runs")
