"""What a run says beside the checks: warnings, which put the result in doubt, and notes, which inform.

What a check of its own judges (faults of the last surface, convergence) is no remark: it would be said twice.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ...run_warning import Grade, RunWarning, each_once
from ..subject import Result, Subject

FEW_POINTS = 50
WORST_FIRST: tuple[Grade, ...] = ("bad", "amber", "good")


@dataclass(frozen=True)
class Remark:
    """A remark is a sentence with what a verdict is at best beside it: `good` for a note."""

    sentence: str
    grade: Grade = "good"


def remarks(subject: Subject) -> list[Remark]:
    """List what a reader must know before trusting the pictures: warnings, the gravest first, then notes."""
    found = [*_list_those_of_stages(subject), *map(Remark, _list_notes(subject))]
    return sorted(found, key=lambda one: WORST_FIRST.index(one.grade))


def warnings_of(found: Iterable[Remark]) -> list[Remark]:
    """Return the remarks that put the result in doubt."""
    return [one for one in found if one.grade != "good"]


def notes_of(found: Iterable[Remark]) -> list[Remark]:
    """Return the remarks that only inform."""
    return [one for one in found if one.grade == "good"]


def count_remarks(found: Sequence[Remark]) -> str:
    """Count the warnings and the notes in words: the same wherever they are counted; empty without any."""
    counts = (("warning", len(warnings_of(found))), ("note", len(notes_of(found))))
    return ", ".join(f"{n} {word}{'' if n == 1 else 's'}" for word, n in counts if n)


def _list_those_of_stages(subject: Subject) -> list[Remark]:
    """List the estimates' warnings, each once, after the name of the stage that gave it."""
    found = each_once(
        warning for result in _estimates_behind(subject) for warning in result.estimate.warnings
    )
    prefix = subject.last.name.removesuffix(subject.last.key)
    return [Remark(prefix + _name_stage(one), one.grade) for one in found]


def _name_stage(one: RunWarning) -> str:
    """Write the sentence of a warning after the name of its stage, which it may begin with."""
    begins = one.sentence.startswith(f"{one.stage} ")
    return one.sentence if begins else f"{one.stage}: {one.sentence}"


def _estimates_behind(subject: Subject) -> list[Result]:
    """Return the last estimate first, then the others of its run in their order."""
    return [
        subject.last,
        *(one for one in subject.results.values() if one.run is subject.last.run and one is not subject.last),
    ]


def _list_notes(subject: Subject) -> list[str]:
    """List what is to be known of the baseline and of the points."""
    said = _describe_baseline(subject.first) if subject.first else []
    if subject.first and subject.first.run is not subject.last.run and not subject.first.estimate.converged:
        said.append(f"{subject.first.name} did not converge: {subject.first.estimate.status}")
    fitted = len(subject.case.points.of(*subject.last.fitted))
    if fitted < FEW_POINTS:
        said.append(f"Only {fitted} points were fitted.")
    if subject.headline == "fitted":
        said.append(
            "Every point was used in the fit, so nothing here shows how accurate the surface is away from "
            "them; cross-validate (folds = 5)."
        )
    return said


def _describe_baseline(first: Result) -> list[str]:
    return [f"{first.name}: {fault}." for fault in first.run.faults_of(first.key)]
