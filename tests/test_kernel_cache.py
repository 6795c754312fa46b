"""A read-only installation without a home still finds a place for compiled code.

Permissions do not bind root: a file stands where the folder for compiled code would be made.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

from o3dls import kernel_cache

SHOW = """
import sys
{before}
import o3dls.geometry.fairing, o3dls.report.drawing.raster
from numba import config
from o3dls.cli.doctor import _check_kernel_cache
print(config.CACHE_DIR, _check_kernel_cache())
"""


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder with an installation that cannot be written, no home, and a folder for temporary files."""
    shutil.copytree(ROOT / "o3dls", tmp_path / "o3dls", ignore=shutil.ignore_patterns("__pycache__"))
    for package in {path.parent for path in (tmp_path / "o3dls").rglob("__init__.py")}:
        (package / "__pycache__").touch()
    (tmp_path / "home").touch()
    (tmp_path / "tmp").mkdir()
    return tmp_path


def show(home: Path, before: str = "", **env: str) -> tuple[str, str]:
    """What a process says of its cache: on stdout and on stderr."""
    paths = {"PYTHONPATH": str(home), "HOME": str(home / "home"), "TMPDIR": str(home / "tmp")}
    clean = {k: v for k, v in os.environ.items() if k not in (kernel_cache.VARIABLE, "XDG_CACHE_HOME")}
    command = [sys.executable, "-c", SHOW.format(before=before)]
    done = subprocess.run(
        command, env=clean | paths | env, cwd=home, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr.strip()


def test_compiled_code_goes_to_a_folder_of_this_user_which_is_said_once(home: Path) -> None:
    for saying in (True, False):
        out, said = show(home)
        (folder,) = (home / "tmp").glob("o3dls-numba-*")
        assert out == f"{folder} ok      kernel cache: writable"
        assert folder.stat().st_mode & 0o077 == 0
        assert said.startswith(f"compiled code is kept in {folder}, as neither") if saying else not said


def test_numba_may_be_there_before_us(home: Path) -> None:
    assert show(home, "import numba")[0].startswith(f"{home / 'tmp'}{os.sep}o3dls-numba-")


def test_a_folder_that_others_can_write_is_not_taken(home: Path) -> None:
    """Numba would run what they put there."""
    ours = home / "tmp" / f"o3dls-numba-{os.getuid()}"
    ours.mkdir(mode=0o777)
    ours.chmod(0o777)
    assert show(home)[0].split()[0] != str(ours)
    ours.rmdir()
    (home / "other").mkdir(mode=0o700)
    ours.symlink_to(home / "other")
    assert show(home)[0].split()[0] != str(ours)


def test_a_home_or_a_named_folder_is_enough(home: Path) -> None:
    for env in ({"HOME": str(home / "mine")}, {"XDG_CACHE_HOME": str(home / "mine")}):
        out, said = show(home, **env)
        assert (out, said) == ("ok      kernel cache: writable", "")
    out, said = show(home, NUMBA_CACHE_DIR=str(home / "named"))
    assert (out, said) == (f"{home / 'named'} ok      kernel cache: writable", "")
    assert not list((home / "tmp").iterdir())
