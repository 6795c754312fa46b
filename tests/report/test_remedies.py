"""What the first screen says to do about each check that is not OK: in words, and once."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from o3dls.case import Points
from o3dls.report.checks import checks
from o3dls.report.grading.check import Check
from o3dls.report.grading.landmarks import WARNED, check_landmarks
from o3dls.report.grading.remarks import remarks
from o3dls.report.grading.remedies import COMPARED, REMEDIES
from o3dls.report.sections.answers import answers
from o3dls.report.sections.outcome import overall
from o3dls.report.subject import Subject, read_subject
from o3dls.run_warning import GRADES, RunWarning
from tests.finished import finished

SWAPPED = RunWarning(
    "landmark-swapped-place",
    "landmark RIPV lies 18 mm from its place on the prior and 8 mm from that of RSPV: was it measured there?",
    "icp",
)
KEPT = RunWarning(
    "stage-kept",
    "level_set lies 0.08 mm farther from left-out points than icp (1.40 against 1.32 mm)",
    "level_set",
)


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    return read_subject([finished(tmp_path_factory.mktemp("remedies") / "run")])


def warned(subject: Subject, *said: RunWarning, points: Points | None = None) -> Subject:
    """The subject as if its run had given these warnings, on these points."""
    run = subject.last.run
    estimates = {name: replace(one, warnings=tuple(said)) for name, one in run.estimates.items()}
    case = run.case if points is None else replace(run.case, points=points)
    found = replace(run, estimates=estimates, case=case)
    results = {name: replace(one, run=found) for name, one in subject.results.items()}
    return replace(subject, results=results, runs=[found])


def next_of(subject: Subject, found: Sequence[Check]) -> str:
    return re.findall(r"<dt>Next</dt><dd>(.*?)</dd>", str(answers(subject, found)))[0]


def with_marks(subject: Subject, **gaps: float) -> Subject:
    """The subject with landmarks of these names, so far from their places on the result."""
    last = subject.last
    marks = last.run.points.of("landmark").select(np.zeros(len(gaps), dtype=np.int64))
    told = {"name": np.array([*gaps]), f"distance_{last.key}_mm": np.array([*gaps.values()])}
    marks = replace(marks, columns={**marks.columns, **told})
    run = replace(last.run, points=marks, case=replace(last.run.case, points=marks))
    results = {name: replace(one, run=run) for name, one in subject.results.items()}
    return replace(subject, results=results, runs=[run])


def test_next_says_what_to_do_about_every_check_and_warning(subject: Subject) -> None:
    for one in checks(subject):
        for grade in ("amber", "bad"):
            told = next_of(subject, [Check(one.name, grade, "said", "short")])  # type: ignore[arg-type]
            without = told.replace(f"find out why this failed: {one.name}", "").strip("; .")
            assert (one.name == "Warnings") or (without and "nothing is asked" not in told), one.name
    alone = [Check("Warnings", "amber", "said", "1 warning")]
    for code in GRADES:
        told = next_of(warned(subject, RunWarning(code, "a sentence", "icp")), alone)
        assert "nothing is asked" not in told, code
        assert "{" not in told, code
    names = {one.name for one in checks(subject)}
    assert {*COMPARED, *REMEDIES} <= {*names, *GRADES}
    assert {*GRADES} <= {*COMPARED, *REMEDIES, *WARNED}


def test_a_landmark_that_is_warned_of_is_to_be_marked_again_once(subject: Subject) -> None:
    found = warned(with_marks(subject, RIPV=9.0, RSPV=3.0), SWAPPED)
    told = next_of(found, [Check("Warnings", "amber", "said", "1 warning")])
    assert told == "mark RIPV again."
    both = [Check("Landmarks", "amber", "far", "RIPV 17 mm"), Check("Warnings", "amber", "said", "1")]
    assert next_of(found, both).count("mark RIPV again") == 1


def test_a_stage_that_is_farther_is_named_with_what_to_use_instead(subject: Subject) -> None:
    told = next_of(warned(subject, KEPT), [Check("Warnings", "amber", "said", "1 warning")])
    assert told == "use icp, which left-out points prefer."
    run = subject.last.run
    faulty = replace(run, validity=run.validity | {"icp": run.validity["icp"] | {"components": 2}})
    results = {name: replace(one, run=faulty) for name, one in subject.results.items()}
    found = warned(replace(subject, results=results, runs=[faulty]), KEPT)
    told = next_of(found, [Check("Warnings", "amber", "said", "1 warning")])
    assert told == "use icp, which left-out points prefer, unless you need a valid surface."


def test_what_is_to_be_compared_is_said_once(subject: Subject) -> None:
    raised = [Check(name, "amber", "said", "short") for name in ("Size", "Volume change")]
    assert next_of(subject, raised) == "check units, heart phase, patient and missing veins."


@pytest.mark.parametrize(
    ("gaps", "grade", "short"),
    [
        ((10.3, 2.0), "amber", "7.4 mm rms; RIPV 10.3 mm"),
        ((4.62, 4.62), "amber", "4.62 mm rms; RIPV 4.6 mm"),
        ((3.0, 2.0), "good", "2.5 mm rms; RIPV 3.0 mm"),
    ],
)
def test_the_number_of_landmarks_that_has_a_limit_is_shown(
    subject: Subject, gaps: tuple[float, float], grade: str, short: str
) -> None:
    found = check_landmarks(with_marks(subject, RIPV=gaps[0], RSPV=gaps[1]))
    assert (found.grade, found.short, found.limit) == (grade, short, "up to 15 mm, 4.6 mm rms")


def test_the_entry_of_landmarks_says_which_is_warned_of_and_where_it_is_measured(subject: Subject) -> None:
    found = check_landmarks(with_marks(warned(subject, SWAPPED), RIPV=3.0, RSPV=2.0))
    assert found.short == "2.5 mm rms; RIPV 3.0 mm on the result; RIPV warned of"
    unused = RunWarning("landmark-not-used", "the landmark RSPV is not used: it lies 20 mm off", "icp")
    found = check_landmarks(with_marks(warned(subject, unused), RIPV=3.0, RSPV=2.0))
    assert found.short.endswith("; RSPV not used")


def test_a_stage_is_named_once_and_a_question_ends_as_one(subject: Subject) -> None:
    (first, second) = remarks(warned(subject, KEPT, SWAPPED))[:2]
    assert first.sentence == KEPT.sentence
    assert second.sentence.startswith("icp: landmark RIPV")
    assert "was it measured there? <" in overall([], [second])
