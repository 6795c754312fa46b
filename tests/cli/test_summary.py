"""What a run ends with: whether to trust it, and where to look."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from o3dls.cli import summary as module
from o3dls.cli.summary import record_grades, say_grades, summary
from o3dls.report.checks import checks
from o3dls.report.cohort.entries import read_entries
from o3dls.report.grading.check import WORDS, Check
from o3dls.report.subject import read_subject
from tests.finished import finished, finished_2d


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("summary") / "run")


def test_the_worst_check_gives_the_word_and_stands_first(run: Path) -> None:
    found = summary(run)
    by_name = {one.name: one for one in checks(read_subject([run]))}
    assert by_name["Converged"].grade == "amber"
    assert (found.word, found.final) == ("CHECK", "level_set")
    assert found.reasons[0] == by_name["Converged"]
    assert {one.name for one in found.reasons} == {
        name for name, one in by_name.items() if one.grade in ("bad", "amber")
    }
    first, second, *_, page, folder = str(found).splitlines()
    assert first == "CHECK  level_set: look at this before you rely on it"
    assert (
        second == "  CHECK  Converged: not converged: level_set (stopped at the largest number of iterations)"
    )
    assert (page, folder) == (f"no report yet: o3dls report {run} writes it", str(run))


@pytest.mark.parametrize("count", range(6))
def test_it_has_at_most_five_lines_and_names_every_reason(
    run: Path, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = [Check(f"Check {k}", "amber", "is doubtful") for k in range(count)]
    given += [Check("Fine", "good", "well"), Check("Unknown", "none", "nothing")]
    monkeypatch.setattr(module, "checks", lambda _: given)
    (run / "report.html").touch()
    found = summary(run)
    text = str(found)
    assert len(text.splitlines()) <= 5
    assert all(one.name in text for one in given[:count])
    assert text.splitlines()[-2:] == [f"open {run / 'report.html'}", str(run)]
    assert found.word == (WORDS["amber"] if count else WORDS["good"])
    assert ("no check found a problem; no data for: Unknown" in text) == (count == 0)
    assert [one["check"] for one in found.record["reasons"]] == [one.name for one in given[:count]]


def test_outlines_have_one_too(tmp_path: Path) -> None:
    assert summary(finished_2d(tmp_path / "run")).final == "level_set"


def test_a_batch_ends_with_its_grades_and_names_each_case_that_is_not_ok(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (doubtful,) = read_entries([run])
    fine = [replace(doubtful, name=f"fine_{k}", grade="good", doubts=()) for k in range(2)]
    bad = replace(doubtful, name="torn", grade="bad", doubts=("Valid mesh: 1 fault", "Warnings: 2 warnings"))
    say_grades([*fine, doubtful, bad])
    assert capsys.readouterr().out.splitlines() == [
        "Grades: 1 FAIL, 1 CHECK, 2 OK",
        "  FAIL  torn: Valid mesh: 1 fault",
        f"  CHECK  {doubtful.name}: {doubtful.doubts[0]}",
    ]
    found = record_grades([*fine, doubtful, bad])
    assert found["grades"] == {"FAIL": 1, "CHECK": 1, "OK": 2}
    assert [one["run"] for one in found["look_at"]] == ["torn", doubtful.name]
    say_grades([])
    assert not capsys.readouterr().out
