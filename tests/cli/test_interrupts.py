"""Ctrl-C and being told to end, at any moment: one line, the code of the signal, nothing half written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tiny import Nudge, ball_case

from o3dls.io.case_writer import write_case
from o3dls.pipeline.pipeline import Pipeline

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143}
# a process that gets a signal where a line of ours says so, with the command line as it is
AT = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
number = int(sys.argv.pop(1))
def strike():
    os.kill(os.getpid(), number)
{set_up}
from o3dls.cli.main import main
main()
"""
IN_AN_IMPORT = """
import builtins
real = builtins.__import__
def slow(name, *rest, **more):
    if name.endswith({module!r}) and "o3dls.cli.commands" in sys.modules or name == {module!r} == "click":
        builtins.__import__ = real
        {how}
    return real(name, *rest, **more)
builtins.__import__ = slow
"""
IN_WRITING = """
import pathlib
real = pathlib.Path.write_bytes
def write(path, data):
    count = real(path, data)
    if path.name.endswith({end!r}):
        pathlib.Path.write_bytes = real
        {how}
    return count
pathlib.Path.write_bytes = write
"""
IN_A_DESTRUCTOR = """
class Doomed:
    def __del__(self):
        strike()
        for _ in range(1000): pass
import o3dls.report.writer as writer
real = writer.write_report
def report(*a, **k):
    doomed = Doomed(); del doomed
    import time; time.sleep(50)
writer.write_report = report
"""
HALF_MADE = """
class Half:
    def __init__(self):
        strike()
        for _ in range(1000): pass
        self.whole = True
    def __del__(self):
        del self.whole
import o3dls.report.writer as writer
writer.write_report = lambda *a, **k: Half()
"""
RUN = "from o3dls.cli.main import main; main()"
SWALLOWED = "try: strike(); [None for _ in range(1000)]\n        except BaseException: pass"
MADE_ANOTHER = SWALLOWED.replace("pass", "raise ImportError('core failed')")


@pytest.fixture(scope="module")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = Pipeline([Nudge()], folds=0).run(ball_case())
    return run.write(tmp_path_factory.mktemp("interrupted") / "run")


def struck(set_up: str, number: signal.Signals, *arguments: str | Path, cwd: Path) -> None:
    """Run a command that gets the signal: it ends with its code and one line, after what it said before."""
    done = subprocess.run(
        [sys.executable, "-c", AT.format(set_up=set_up), str(int(number)), *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=60,
    )
    assert done.returncode == CODES[number]
    *before, last = done.stderr.splitlines()
    assert last == "o3dls: interrupted"
    assert all("the format has no room for" in line for line in before)


@pytest.mark.parametrize(
    ("number", "module", "how"),
    [
        (signal.SIGINT, "click", "strike()"),
        (signal.SIGTERM, "click", MADE_ANOTHER),
        (signal.SIGTERM, "numpy", "strike()"),
        (signal.SIGINT, "numpy", MADE_ANOTHER),
        (signal.SIGTERM, "report.writer", MADE_ANOTHER),
    ],
)
def test_in_an_import(
    number: signal.Signals, module: str, how: str, finished_run: Path, tmp_path: Path
) -> None:
    set_up = IN_AN_IMPORT.format(module=module, how=how)
    struck(set_up, number, "report", finished_run, "--out", tmp_path / "page.html", cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_where_a_library_swallows_it_the_code_says_so_in_the_end(finished_run: Path, tmp_path: Path) -> None:
    set_up = IN_AN_IMPORT.format(module="numpy", how=SWALLOWED)
    struck(set_up, signal.SIGTERM, "report", finished_run, "--out", tmp_path / "page.html", cwd=tmp_path)


def test_a_library_that_would_crash_at_the_end_is_not_asked(finished_run: Path, tmp_path: Path) -> None:
    """The compiler of the loops did so, rarely."""
    how = "import atexit; atexit.register(os.abort); strike()"
    set_up = IN_AN_IMPORT.format(module="report.writer", how=how)
    struck(set_up, signal.SIGTERM, "report", finished_run, "--out", tmp_path / "page.html", cwd=tmp_path)


def test_in_a_destructor(finished_run: Path, tmp_path: Path) -> None:
    begun = time.perf_counter()
    struck(IN_A_DESTRUCTOR, signal.SIGTERM, "report", finished_run, "--out", "page.html", cwd=tmp_path)
    assert time.perf_counter() - begun < 40.0  # it did not sleep on
    assert list(tmp_path.iterdir()) == []


def test_a_destructor_of_what_is_half_made_has_nothing_to_say(finished_run: Path, tmp_path: Path) -> None:
    """llvmlite's do so where the compiler is interrupted."""
    struck(HALF_MADE, signal.SIGINT, "report", finished_run, "--out", "page.html", cwd=tmp_path)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_while_loops_are_compiled(number: signal.Signals, tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", f"import signal; signal.signal(2, signal.default_int_handler); {RUN}", "demo"],
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
    ) as process:
        assert process.stderr is not None
        while not (line := process.stderr.readline()).startswith("compiling"):
            assert line, "the demo ended without compiling anything"
        time.sleep(1.0)
        process.send_signal(number)
        *_, last = process.communicate(timeout=60)[1].splitlines()
    assert (process.returncode, last) == (CODES[number], "o3dls: interrupted")


def test_little_is_imported_before_the_command_listens() -> None:
    """Ctrl-C in that time is answered by Python itself, with a traceback."""
    show = "import sys; import o3dls.cli.main; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-S", "-c", show], capture_output=True, text=True, check=True, env=os.environ
    )
    assert {"o3dls", "o3dls.cli.main", "signal"} <= set(done.stdout.split())
    assert not {"typing", "threading", "logging", "tempfile", "click", "numpy"} & set(done.stdout.split())


@pytest.mark.parametrize(
    ("number", "format", "name", "written", "times"),
    [
        (signal.SIGINT, "stl", "la.stl", ".stl", 1),
        (signal.SIGTERM, "stl", "la.stl", ".json", 3),
        (signal.SIGTERM, "mask_nrrd", "la.nrrd", ".nrrd", 1),
        (signal.SIGINT, "opencarp", "la.pts", ".elem", 2),
    ],
)
def test_in_writing_an_export(
    number: signal.Signals,
    format: str,
    name: str,
    written: str,
    times: int,
    finished_run: Path,
    tmp_path: Path,
) -> None:
    set_up = IN_WRITING.format(end=written, how="strike(); " * times)
    struck(set_up, number, "export", finished_run, "--format", format, "--out", name, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_before_python_has_begun(tmp_path: Path) -> None:
    """A signal to a process that has done nothing yet ends it: by itself, or as above."""
    for delay in (0.0, 0.01, 0.03, 0.06):
        with subprocess.Popen(
            [sys.executable, "-m", "o3dls", "doctor"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=tmp_path,
            env=os.environ,
        ) as process:
            time.sleep(delay)
            process.terminate()
            error = process.communicate(timeout=60)[1]
        assert (process.returncode, error) in ((-15, b""), (143, b"o3dls: interrupted\n"))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no groups of processes that get a signal")
@pytest.mark.parametrize("delay", [0.1, 0.3, 0.6, 1.0, 1.6])
def test_a_batch_whose_processes_begin(delay: float, tmp_path: Path) -> None:
    """Ctrl-C in a terminal reaches all processes of the command."""
    write_case(tmp_path / "ball", ball_case())
    (tmp_path / "pipe.toml").write_text('folds = 0\n[[stage]]\nuse = "icp"\n')
    command = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); " + RUN
    with subprocess.Popen(
        [sys.executable, "-c", command, "batch", "ball", "--pipeline", "pipe.toml", "--out", "runs"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        start_new_session=True,
    ) as process:
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGINT)
        error = process.communicate(timeout=60)[1]
    progress = ("compiling", "icp: ", "stopping: ", "1 of 1: ")
    said = [line for line in error.splitlines() if not line.startswith(progress)]
    finished = process.returncode == 0 and not said
    early = process.returncode in (1, 130, -2) and "o3dls: interrupted" not in error and delay <= 0.3
    assert finished or early or (process.returncode, said) == (130, ["o3dls: interrupted"])
