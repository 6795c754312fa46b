"""A command that is killed leaves what it writes whole or not there, and the next one clears up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tiny import ball_case

from o3dls.io.case_writer import write_case
from o3dls.io.manifest import missing
from o3dls.io.surfaces import read_surface
from o3dls.runs.folder import read_run
from tests.finished import finished

KILLS = int(os.environ.get("O3DLS_KILLS", "2"))  # of each command; 14 take some minutes
PIPELINE = 'folds = 0\n[[stage]]\nuse = "landmarks"\n[[stage]]\nuse = "icp"\n[[write]]\nuse = "report"\n'

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no kill -9")


def given(folder: Path, what: str) -> tuple[list[str], Path]:
    """A command, and what it makes."""
    if what == "export":
        out = folder / "out" / "a.vtp"
        out.parent.mkdir()
        return ["export", str(finished(folder / "run")), "--format", "vtp", "--out", str(out)], out
    for name in ("one", "two"):
        write_case(folder / name, ball_case())
    (folder / "p.toml").write_text(PIPELINE)
    out = folder / "out"
    cases = [str(folder / "one"), str(folder / "two")]
    if what == "batch":
        return ["batch", *cases, "--pipeline", str(folder / "p.toml"), "--out", str(out)], out
    return ["run", str(folder / "p.toml"), "--case", cases[0], "--out", str(out / "one")], out


def check_whole(out: Path) -> None:
    """Raise where anything under its own name is torn."""
    if out.suffix == ".vtp":
        if out.exists():
            read_surface(out)
        return
    for name in ("one", "two"):
        if (out / name).exists():
            assert missing(out / name) == []
            read_run(out / name)
    if (out / "cohort.csv").exists():
        assert (out / "cohort.csv").read_text().endswith("\n")
    if (out / "cohort.html").exists():
        assert (out / "cohort.html").read_text(encoding="utf-8").endswith("</html>\n")


def begin(command: list[str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "o3dls", *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


@pytest.mark.parametrize("what", ["run", "batch", "export"])
def test_what_a_killed_command_made_is_whole_or_not_there(what: str, tmp_path: Path) -> None:
    command, out = given(tmp_path, what)
    again = [] if what == "export" else ["--force"]
    started = time.monotonic()
    _, said = (process := begin([*command, *again])).communicate()
    assert process.returncode in (0, 1), said
    whole = time.monotonic() - started
    moments = np.random.default_rng(7).uniform(0.2, 1.0, KILLS) * whole
    for moment in moments:
        process = begin([*command, *again])
        time.sleep(float(moment))
        os.killpg(process.pid, signal.SIGKILL)  # with every process that it began
        process.communicate()
        check_whole(out)
    _, said = (process := begin([*command, *again])).communicate()
    assert process.returncode in (0, 1), said
    check_whole(out)
    parent = out if out.is_dir() else out.parent
    assert not list(parent.glob("*.partial-*")), "what the killed ones left is removed"
