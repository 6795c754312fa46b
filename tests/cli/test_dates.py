"""A run whose run.json has a date beyond the years of a calendar, by a clock that was wrong, is a whole run:
every command reads it, and says that the time is not known.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from o3dls.cli.commands import cli
from tests.finished import finished

YEAR_10000 = 253_402_300_800  # seconds: one more than the last of the year 9999
COMMANDS = {
    "report": ["report", "runs/one"],
    "compare": ["compare", "runs/one", "runs/other", "--out", "page.html"],
    "export": ["export", "runs/one", "--format", "ply", "--out", "exported.ply"],
    "cohort": ["cohort", "runs"],
}


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two finished runs; the file system, which may not know such dates, says that both ended in that
    year.
    """
    for name in ("one", "other"):
        finished(tmp_path / "runs" / name)
    told = Path.stat

    def dated(path: Path, **how: bool) -> os.stat_result:
        found = told(path, **how)
        return os.stat_result((*found[:8], YEAR_10000, found[9])) if path.name == "run.json" else found

    monkeypatch.setattr(Path, "stat", dated)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", COMMANDS)
def test_a_run_of_the_year_10000_is_read(name: str, runs: Path) -> None:
    done = CliRunner().invoke(cli, COMMANDS[name], catch_exceptions=False)
    assert done.exit_code == 0, done.output


def test_its_report_says_that_the_time_is_not_known(runs: Path) -> None:
    CliRunner().invoke(cli, COMMANDS["report"], catch_exceptions=False)
    page = (runs / "runs/one/report.html").read_text(encoding="utf-8")
    assert "at a time that is not known" in page
