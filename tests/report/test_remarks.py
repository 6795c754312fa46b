"""Verdict, strip and warnings are one judgement: no words of one contradict those of another."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from o3dls.report.checks import checks
from o3dls.report.grading.check import WORDS
from o3dls.report.grading.remarks import notes_of, remarks, warnings_of
from o3dls.report.sections.outcome import outcome_section, overall, strip
from o3dls.report.subject import Subject, read_subject
from o3dls.run_warning import RunWarning
from tests.finished import finished

NOTE = RunWarning("order-lost", "the order is lost", "icp")
DOUBT = RunWarning("map-shift", "a part is shifted", "icp")
WRONG = RunWarning("many-outliers", "most are outliers", "icp")
SAID = ((), (NOTE,), (DOUBT,), (NOTE, DOUBT), (NOTE, DOUBT, WRONG))
STEPS = {"at rest": True, "nearly": False, "moving": False}


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    return read_subject([finished(tmp_path_factory.mktemp("remarks") / "run")])


def of_run(subject: Subject, said: Sequence[RunWarning], motion: str, faults: bool) -> Subject:
    """The subject as if its run had ended so."""
    run, key = subject.last.run, subject.last.key
    facts = {} if motion == "moving" else {"last_step": 0.01}
    common: dict[str, Any] = {"warnings": tuple(said), "facts": facts, "sigma": 1.0}
    estimates = {
        name: replace(one, **common, converged=STEPS[motion] or name != key)
        for name, one in run.estimates.items()
    }
    validity = {**run.validity, key: run.validity[key] | ({"components": 2} if faults else {})}
    found = replace(run, estimates=estimates, validity=validity)
    results = {name: replace(one, run=found) for name, one in subject.results.items()}
    return replace(subject, results=results, runs=[found])


def counted(word: str, text: str) -> int:
    found = re.search(rf"(\d+) {word}s?\b", text)
    return int(found[1]) if found else 0


@pytest.mark.parametrize(("said", "motion", "faults"), list(product(SAID, STEPS, (False, True))))
def test_verdict_strip_and_lists_say_one_thing(
    subject: Subject, said: Sequence[RunWarning], motion: str, faults: bool
) -> None:
    ended = of_run(subject, said, motion, faults)
    found = {one.name: one for one in checks(ended)}
    told = remarks(ended)
    head, entries, body = (
        overall([*found.values()], told),
        strip([*found.values()], "it"),
        outcome_section(ended),
    )
    grave = sum(one.grade != "good" for one in said)
    assert len(warnings_of(told)) == grave
    # as many warnings, and notes, wherever they are counted
    assert counted("warning", head) == counted("warning", entries) == grave
    assert counted("note", head) == len(notes_of(told)) == len(said) - grave
    assert (found["Warnings"].grade == "good") == (grave == 0)
    assert ('class="warnings"' in body.body) == (grave > 0)
    # what did not converge is said by its check alone, and a motion at rest is nowhere said to move on
    assert (found["Converged"].grade == "amber") == (motion == "moving")
    assert body.body.count("not converge") == (motion == "moving")
    assert "converge" not in " ".join(one.sentence for one in told)
    # a fault of the surface is a failed check, and no warning beside it
    assert (found["Valid surface"].grade == "bad") == faults
    assert body.body.count("2 components") == faults
    doubted = [one for one in found.values() if one.grade in ("amber", "bad")]
    assert ("No check found a problem" in head) == (not doubted)
    if grave:
        assert f">{WORDS['good']}<" not in head
    assert [one.grade for one in told] == sorted(
        (one.grade for one in told), key=["bad", "amber", "good"].index
    )


def test_warnings_that_alone_are_in_doubt_are_not_counted_twice(subject: Subject) -> None:
    ended = of_run(subject, (DOUBT,), "at rest", ())
    alone = [one for one in checks(ended) if one.grade != "amber" or one.name == "Warnings"]
    head = overall(alone, remarks(ended))
    assert "Look at this before you use the surface. <span>" in head
    assert head.count("warning") == 1
    assert "icp: a part is shifted" in head


def test_a_page_has_the_same_count(subject: Subject, tmp_path: Path) -> None:
    folder = finished(tmp_path / "run")
    found = {one.name: one.short for one in checks(read_subject([folder]))}
    assert found["Warnings"] == "1 note"
