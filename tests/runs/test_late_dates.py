"""A run that a wrong clock dated beyond the years of a calendar is read as any other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from o3dls.runs.folder import day_of_end
from tests.finished import finished
from tests.said import said_by

YEAR_10000 = 253_402_300_800.0  # seconds since 1970


class Late:
    """The state of a file, with another date: not every file system can hold it."""

    def __init__(self, real: Any) -> None:
        self._real = real
        self.st_mtime = YEAR_10000

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)


@pytest.mark.parametrize("command", ["report", "export", "compare", "cohort"])
def test_every_command_reads_it(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = finished(tmp_path / "runs" / "run")
    monkeypatch.chdir(tmp_path)
    stat = Path.stat

    def late(path: Path, **how: Any) -> Any:
        found = stat(path, **how)
        return Late(found) if path.name == "run.json" else found

    monkeypatch.setattr(Path, "stat", late)
    assert day_of_end(run) == "at a time that is not known"
    more = ["--format", "stl"] if command == "export" else []
    code, said = said_by(command, run.parent if command == "cohort" else run, *more)
    assert code in (0, 1), said
    assert "internal error" not in said
    assert "Traceback" not in said
