"""benchmarks.times: cases take turns between versions, and the table tells the longest and the ratio."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from benchmarks import times
from benchmarks.times import Version, chosen, row

ECHO = """
import sys
for line in sys.stdin:
    if "bad" in line: break
    print("a library says something")
    print([2.5, 4.0], flush=True)
"""


def test_a_row_has_the_longest_and_the_ratio_to_the_other_version() -> None:
    ours, theirs = [(1.0, 2.0), (2.0, 3.0), (5.0, 6.0)], [(4.0, 4.0), (4.0, 4.0), (9.0, 9.0)]
    assert row("g", ours, []) == ["g", "3", "2.00 (3.00)", "5.00", "2.50"]
    assert row("g", ours, theirs)[5:] == ["4.00 (4.00)", "0.50", "0.75"]


def test_the_first_cases_of_each_group_are_taken(tmp_path: Path) -> None:
    for name in ("whole_1000_even_3", "whole_1000_even_1", "whole_1000_even_2", "whole_4000_even_1"):
        (tmp_path / name).mkdir()
        for file in ("points.csv", "prior.ply"):
            (tmp_path / name / file).touch()
    assert [case.name for case in chosen([tmp_path], 2)] == [
        "whole_1000_even_1",
        "whole_1000_even_2",
        "whole_4000_even_1",
    ]
    assert len(chosen([tmp_path], None)) == 4


def test_a_version_answers_case_by_case_and_its_end_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(times, "SERVER", ECHO)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: None)  # nothing to compile
    version = Version(tmp_path)
    try:
        assert [version.seconds(tmp_path / name) for name in ("one", "two")] == [(2.5, 4.0)] * 2
        with pytest.raises(SystemExit, match="bad: the program ended without a result"):
            version.seconds(tmp_path / "bad")
    finally:
        version.process.kill()
        version.process.communicate()
