"""What stands around a command, in its folder, its variables and its streams, neither runs in its place nor
costs it its work.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from tiny import ball_case

from o3dls.child_processes import safe_path
from o3dls.cli.environment import check_environment
from o3dls.errors import InputError
from o3dls.io.case_writer import write_case
from o3dls.pipeline.workers import workers

LANDMARKS = 'folds = 2\n[[stage]]\nuse = "landmarks"\n'
# modules of Python, of the libraries and of ours that some process of a command imports
NAMES = (
    *("signal", "random", "copy", "json", "logging", "socket", "selectors", "struct", "pickle", "threading"),
    *("tempfile", "multiprocessing", "encodings", "numpy", "scipy", "numba", "open3d", "click", "pydantic"),
    *("matplotlib", "trimesh", "o3dls", "yaml", "site"),
)
STRAY = "from pathlib import Path\nPath(__file__).with_name('RAN').open('a').write(__name__ + '\\n')\n"


def o3dls(*arguments: str | Path, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    code = "import sys; del sys.path[0]; from o3dls.cli.main import main; main()"  # as the script `o3dls`
    command = [sys.executable, "-W", "error", "-c", code, *map(str, arguments)]
    around = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    return subprocess.run(
        command, capture_output=True, text=True, cwd=cwd, timeout=300, env={**around, **variables}, input=""
    )


@pytest.fixture
def strange(tmp_path: Path) -> Path:
    """A folder in which somebody has left a file for each of the names, and a small case."""
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(STRAY)
    write_case(tmp_path / "ball", ball_case())
    (tmp_path / "pipe.toml").write_text(LANDMARKS)
    return tmp_path


@pytest.mark.parametrize(
    "command",
    [
        ("batch", "ball", "--pipeline", "pipe.toml", "--out", "runs", "--jobs", "2"),
        ("batch", "ball", "--pipeline", "pipe.toml", "--out", "runs", "--scheduler", "local"),
        ("run", "pipe.toml", "--case", "ball", "--out", "out"),
        ("live", "ball", "--headless", "--record", "rec"),
        ("doctor",),
    ],
    ids=["batch", "scheduler", "folds", "live", "doctor"],
)
def test_files_of_the_working_folder_named_like_modules_are_not_run(
    strange: Path, command: tuple[str, ...]
) -> None:
    if "--scheduler" in command:
        pytest.importorskip("distributed")
    done = o3dls(*command, cwd=strange)
    assert not (strange / "RAN").exists(), (strange / "RAN").read_text()
    assert done.returncode == 0, done.stderr


def test_neither_are_they_by_python_m(strange: Path) -> None:
    around = {**os.environ, "PYTHONPATH": str(ROOT)}
    (strange / "o3dls.py").unlink()  # which is what `python -m o3dls` is told to run
    done = subprocess.run(
        [sys.executable, "-m", "o3dls", "stages"], cwd=strange, env=around, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert not (strange / "RAN").exists()


def test_every_process_of_ours_is_begun_with_a_safe_path() -> None:
    begins = re.compile(r"get_context\(|\[sys\.executable|LocalCluster\(|Popen\(")
    for path in (ROOT / "o3dls").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if begins.search(text):
            assert re.search(r"safe_path\(\)|sys\.executable, \"-P\"", text), path


def test_threads_that_begin_processes_at_once_leave_the_environment_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first ends while the second is within: what the second found set is not what was there before."""
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    first, second = safe_path(), safe_path()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert os.environ["PYTHONSAFEPATH"] == "1"
    second.__exit__(None, None, None)
    assert "PYTHONSAFEPATH" not in os.environ
    monkeypatch.setenv("PYTHONSAFEPATH", "")
    with safe_path(), safe_path():
        assert os.environ["PYTHONSAFEPATH"] == "1"
    assert os.environ["PYTHONSAFEPATH"] == ""


def test_numbas_file_in_the_working_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: .\n")
    done = o3dls("stages", cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert ".numba_config.yaml: numba would obey this file" in done.stderr


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("NUMBA_NUM_THREADS", "0"),
        ("NUMBA_NUM_THREADS", "-1"),
        ("NUMBA_NUM_THREADS", "many"),
        ("NUMBA_NUM_THREADS", ""),
        ("NUMBA_NUM_THREADS", "9" * 30),
        ("SOURCE_DATE_EPOCH", "x"),
        ("SOURCE_DATE_EPOCH", "-5"),
        ("SOURCE_DATE_EPOCH", "1.5"),
        ("SOURCE_DATE_EPOCH", "9" * 12),
    ],
)
def test_variables_that_libraries_cannot_use_are_refused_before_the_work(name: str, given: str) -> None:
    with pytest.raises(InputError, match=rf"{name} = '{given}': must be a whole number"):
        check_environment({name: given})


def test_variables_that_libraries_can_use_are_let_be() -> None:
    check_environment({"NUMBA_NUM_THREADS": "2", "SOURCE_DATE_EPOCH": "0"})
    check_environment({})


def test_pictures_do_not_depend_on_what_matplotlib_finds(tmp_path: Path) -> None:
    write_case(tmp_path / "ball", ball_case())
    (tmp_path / "pipe.toml").write_text(
        'folds = 0\n[[stage]]\nuse = "landmarks"\n[[write]]\nuse = "report"\npdf = true\n'
    )
    for name, given in (("one", {}), ("two", {"MPLBACKEND": "nonsense", "SOURCE_DATE_EPOCH": "0"})):
        (tmp_path / "matplotlibrc").write_text("backend: nonsense\nfont.size: 40\n" if given else "")
        done = o3dls("run", "pipe.toml", "--case", "ball", "--out", name, cwd=tmp_path, **given)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / name / "report.pdf").is_file()
    one, two = ((tmp_path / name / "figures") for name in ("one", "two"))
    pictures = sorted(path.name for path in one.iterdir())
    assert pictures
    assert all((one / name).read_bytes() == (two / name).read_bytes() for name in pictures)


CLOSED = """
import os, subprocess, sys
for number in map(int, sys.argv[1]):
    os.close(number)
os.execv(sys.executable, [sys.executable, "-m", "o3dls", *sys.argv[2:]])
"""


@pytest.mark.parametrize("closed", ["2", "0", "02", "012"])
def test_a_command_does_its_work_with_closed_streams(tmp_path: Path, closed: str) -> None:
    write_case(tmp_path / "ball", ball_case())
    (tmp_path / "pipe.toml").write_text(LANDMARKS)
    done = subprocess.run([sys.executable, "-c", CLOSED, closed, "--help"], capture_output=True, cwd=tmp_path)
    assert done.returncode == 0
    assert b"Usage" in done.stdout or "1" in closed
    run = ["run", "pipe.toml", "--case", "ball", "--out", "out"]
    done = subprocess.run([sys.executable, "-c", CLOSED, closed, *run], capture_output=True, cwd=tmp_path)
    assert done.returncode == 0
    assert (tmp_path / "out/run.json").is_file()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ball", "out", "pipe.toml"]


def test_the_environment_of_who_imports_o3dls_stays_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """The path of what a program begins after it has used ours is its own affair."""
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    with workers(1) as pool:
        assert pool.submit(os.getenv, "PYTHONSAFEPATH").result() == "1"
    assert "PYTHONSAFEPATH" not in os.environ
