"""`./dev test` and the browser's tests where parts of the system are missing and cannot be installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT
from test_packaging import PROJECT

from tests.browser import chromium

TOOLS = ("sh", "dirname", "sed", "cat", "cksum", "grep", "touch", "uname", "tail", "mkdir")
LIBRARIES = "libGL.so.1 libEGL.so.1 libOpenGL.so.0 libusb-1.0.so.0"
PYTHON = """#!/bin/sh
echo "$@" >>calls
case "$*" in
    *purelib*) mkdir -p site; echo site ;;
    *chromium\\(\\)*) [ -e browser ] ;;
    *"playwright install"*) exit 1 ;;
esac
"""


def script(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A clone of one file on a system of few tools, without a browser and without the right to install it."""
    tmp_path /= "o3dls"
    tmp_path.mkdir()
    for name in ("dev", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    script(tmp_path / ".venv/bin/python", PYTHON)
    script(tmp_path / "bin/id", "#!/bin/sh\necho 1000\n")
    lines = "".join(f"\t{name} (libc6) => /lib/{name}\\n" for name in LIBRARIES.split())
    script(tmp_path / "bin/ldconfig", f"#!/bin/sh\nprintf '{lines}'\n")
    for name in TOOLS:
        found = shutil.which(name)
        assert found is not None
        (tmp_path / "bin" / name).symlink_to(found)
    (tmp_path / "bin/python3").symlink_to(sys.executable)
    return tmp_path


def dev(clone: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command, env = ["./dev", *arguments], {"PATH": str(clone / "bin")}
    return subprocess.run(command, cwd=clone, env=env, capture_output=True, text=True, check=False)


def test_a_missing_browser_is_said_with_its_remedy_and_looked_for_again(clone: Path) -> None:
    for _ in range(2):
        (clone / "calls").unlink(missing_ok=True)
        done = dev(clone, "test")
        assert done.returncode == 0
        (said,) = (line for line in done.stderr.splitlines() if "browser" in line)
        assert "will be skipped; to fix this, run: " in said
        assert "libatomic1" in said or "--with-deps" in said
        assert "playwright install chromium" in (clone / "calls").read_text()
        assert not (clone / ".venv/stamp-browser").exists()
    (clone / "browser").touch()
    assert "browser" not in dev(clone, "test").stderr
    assert (clone / ".venv/stamp-browser").exists()


def test_without_python_it_is_said_in_one_line_what_to_install(clone: Path) -> None:
    (clone / "bin/python3").unlink()
    script(clone / ".venv/bin/python", "#!/bin/sh\nexit 1\n")
    script(clone / "bin/ldconfig", "#!/bin/sh\n")
    done = dev(clone, "demo")
    assert done.returncode == 1
    (line,) = (line for line in done.stderr.splitlines() if "to fix this, run: " in line)
    assert line.endswith(" python3 libgl1 libegl1 libopengl0 libusb-1.0-0 python3-venv ")
    assert "PYTHON=/path/to/python ./dev demo" in done.stderr


def test_the_tests_run_in_two_processes_and_take_arguments(clone: Path) -> None:
    (clone / "browser").touch()
    assert dev(clone, "test", "-k", "two words").returncode == 0
    options = "-q -n 2 --dist loadfile --no-loadscope-reorder"
    assert (clone / "calls").read_text().splitlines()[-1] == f"-m pytest {options} -m not slow -k two words"
    assert dev(clone, "test", "--all", "-x").returncode == 0
    assert (clone / "calls").read_text().splitlines()[-1] == f"-m pytest {options} -x"


def test_all_tests_look_for_the_libraries_of_slicer(clone: Path) -> None:
    (clone / "browser").touch()
    assert "slicer" not in dev(clone, "test").stderr
    done = dev(clone, "test", "--all")
    assert done.returncode == 0
    assert "slicer-core has no wheel for this Python or system: its tests will be skipped" in done.stderr
    script(clone / ".dev/slicer/bin/python", '#!/bin/sh\necho "slicer $@" >>calls\n')
    assert "skipped" not in dev(clone, "test", "--all").stderr
    install = "slicer -m pip install -q --only-binary :all: slicer-core>=5.13"
    assert (clone / "calls").read_text().splitlines().count(install) == 1
    assert "slicer" not in dev(clone, "test", "--all").stderr  # it is there
    (wanted,) = PROJECT["project"]["optional-dependencies"]["slicer-test"]
    assert wanted.split(";")[0] == install.split()[-1]


def test_a_script_beside_a_clone_named_o3dls_finds_the_package(clone: Path) -> None:
    """The folder of the clone would pass for a package without a file of its own."""
    for name in ("o3dls", "pipelines", "data_synth"):
        shutil.copytree(ROOT / name, clone / name, ignore=shutil.ignore_patterns("__pycache__"))
    (clone / "README.md").touch()
    (clone / "LICENSE").touch()
    done = dev(clone, "setup")
    assert done.returncode == 0
    assert ". .venv/bin/activate" in done.stderr
    assert (clone / "calls").read_text().count("doctor --compile") == 1
    assert dev(clone, "setup").returncode == 0
    assert (clone / "calls").read_text().count("doctor --compile") == 1  # it is done
    build = "from setuptools.build_meta import build_editable as build; print(build('out'))"
    made = subprocess.run(
        [sys.executable, "-c", build], cwd=clone, capture_output=True, text=True, check=True
    )
    zipfile.ZipFile(clone / "out" / made.stdout.splitlines()[-1]).extractall(clone / "site")
    beside = clone.parent / "script.py"
    beside.write_text(
        f"import site; site.addsitedir({str(clone / 'site')!r})\n"
        "from o3dls import InputError\nfrom o3dls.resources import pipeline_files\n"
        "print(InputError.__module__, *pipeline_files())\n"
    )
    command = [sys.executable, "-S", str(beside)]
    env = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("o3dls.errors ")
    assert "default" in done.stdout


def outcome(folder: Path, env: dict[str, str]) -> str:
    """What pytest says of a test that asks for a browser."""
    (folder / "test_one.py").write_text(
        "from tests.browser import chromium\n\n\ndef test_one():\n"
        "    with chromium() as launch:\n        launch()\n"
    )
    paths = {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    command = [sys.executable, "-m", "pytest", "-q", "-rs", "-W", "error", "-p", "no:dash", "test_one.py"]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | paths | env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def test_where_the_browsers_driver_dies_its_tests_are_skipped_with_the_reason(tmp_path: Path) -> None:
    pytest.importorskip("playwright.sync_api")
    script(tmp_path / "node", "#!/bin/sh\necho 'node: libatomic.so.1: cannot open' >&2\nexit 127\n")
    said = outcome(tmp_path, {"PLAYWRIGHT_NODEJS_PATH": str(tmp_path / "node")})
    assert "1 skipped" in said
    assert "node: libatomic.so.1: cannot open" in said


def test_where_the_browser_dies_its_tests_are_skipped_with_the_reason(tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    assert playwright
    script(tmp_path / "chromium", "#!/bin/sh\necho 'chromium: no such snap' >&2\nexit 1\n")
    said = outcome(tmp_path, {"PATH": os.pathsep.join([str(tmp_path), os.environ["PATH"]])})
    assert "1 skipped" in said
    assert "does not start" in said


def test_docs_builds_the_site_and_stops_at_a_warning(clone: Path) -> None:
    done = dev(clone, "docs")
    assert done.returncode == 0, done.stderr
    assert "build/docs/index.html" in done.stderr
    calls = (clone / "calls").read_text()
    assert "-e .[docs]" in calls
    assert "-m sphinx -q -W --keep-going -b html docs build/docs" in calls


def test_a_process_starts_its_browser_once_and_leaves_no_page_in_it() -> None:
    with chromium() as launch:
        first = launch(webgl=False)
        first.new_page()
    assert first.contexts == []
    with chromium() as launch:
        assert launch(webgl=False) is first
