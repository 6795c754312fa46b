"""Completion as a shell asks for it: by variables of the environment."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tiny import Nudge, ball_case

from o3dls.pipeline.pipeline import Pipeline


def asked(**env: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "o3dls"], env=os.environ | env, capture_output=True, text=True, check=False
    )


def completed(*words: str) -> list[str]:
    """What bash would offer for the last word."""
    done = asked(
        _O3DLS_COMPLETE="bash_complete", COMP_WORDS=" ".join(["o3dls", *words]), COMP_CWORD=str(len(words))
    )
    assert (done.returncode, done.stderr) == (0, "")
    return [line.removeprefix("plain,") for line in done.stdout.splitlines() if line]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_gets_its_script(shell: str) -> None:
    done = asked(_O3DLS_COMPLETE=f"{shell}_source")
    assert done.returncode == 0
    assert "_O3DLS_COMPLETE" in done.stdout


def test_a_shell_that_is_not_known_is_refused() -> None:
    done = asked(_O3DLS_COMPLETE="csh_source")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("o3dls: _O3DLS_COMPLETE = 'csh_source': must be bash_source,")


def test_stages_parameters_formats_and_packages_are_known() -> None:
    assert completed("stages", "l") == ["landmarks", "level_set"]
    assert completed("run", "--set", "ic") == ["icp."]
    assert "icp.keep=" in completed("batch", "--set", "icp.k")
    assert completed("run", "--set", "nothing.k") == []
    assert completed("export", "--format", "mask") == ["mask_nifti", "mask_nrrd"]
    assert completed("settings", "m") == ["motion"]


def test_estimates_are_those_of_the_run(tmp_path: Path) -> None:
    run = Pipeline([Nudge()], folds=0).run(ball_case()).write(tmp_path / "run")
    assert completed("export", str(run), "--estimate", "n") == ["nudge"]
    assert completed("report", str(run), "--compare", "") == ["nudge", "start"]
    assert completed("export", str(tmp_path), "--estimate", "n") == []
