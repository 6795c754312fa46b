"""What a run ends with on the terminal: whether its result can be trusted, by the checks of the report, and
where to look.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..report.checks import checks
from ..report.cohort.grades import count_grades, describe_grades, raised
from ..report.grading.check import WORDS, Check, Grade
from ..report.subject import read_subject
from ..report.writer import REPORT
from .words import say, say_wrapped

if TYPE_CHECKING:
    from ..report.cohort.entries import Entry
    from ..runs.run import Run

COLOURS = {WORDS["bad"]: "red", WORDS["amber"]: "yellow", WORDS["good"]: "green"}
WORST_FIRST: tuple[Grade, ...] = ("bad", "amber", "good")
ADVICE = {
    "bad": "do not rely on it",
    "amber": "look at this before you rely on it",
    "good": "no check found a problem",
}
MOST_REASONS = 2  # so that all fits into five lines


@dataclass(frozen=True)
class Summary:
    """A summary gives the worst grade of the checks on the last estimate of a run, and each check that is not
    OK, worst first.
    """

    folder: Path
    final: str
    grade: Grade
    reasons: tuple[Check, ...]
    without_data: tuple[str, ...]
    report: Path | None

    @property
    def word(self) -> str:
        return WORDS[self.grade]

    @property
    def record(self) -> dict[str, Any]:
        """The summary as plain values, JSON-ready."""
        return {
            "folder": str(self.folder),
            "report": str(self.report) if self.report else None,
            "final": self.final,
            "verdict": self.word,
            "reasons": [
                {"check": one.name, "grade": WORDS[one.grade], "said": one.said} for one in self.reasons
            ],
            "without_data": list(self.without_data),
        }

    def __str__(self) -> str:
        """Write at most five lines; the last is the run folder alone."""
        lines = [f"{self.word}  {self.final}: {ADVICE[self.grade]}"]
        if self.grade == "good" and self.without_data:
            lines[0] += f"; no data for: {', '.join(self.without_data)}"
        shown = MOST_REASONS if len(self.reasons) <= MOST_REASONS else MOST_REASONS - 1
        lines += [f"  {WORDS[one.grade]}  {one.name}: {one.said}" for one in self.reasons[:shown]]
        if left := [one.name for one in self.reasons[shown:]]:
            lines.append(f"  and {len(left)} more: {', '.join(left)}")
        folder = shlex.quote(str(self.folder))
        lines.append(
            f"open {self.report}" if self.report else f"no report yet: o3dls report {folder} writes it"
        )
        return "\n".join([*lines, str(self.folder)])

    def say(self) -> None:
        """Print the lines; on a terminal wrapped at words, and grades that ask for a look in colour."""
        for line in str(self).splitlines():
            say_wrapped(line, colour=COLOURS.get(line.split()[0]))


def summary(folder: Path, run: Run | None = None) -> Summary:
    """Summarise a finished run, read from its folder where it is not at hand. Raises InputError where the
    folder is none.
    """
    subject = read_subject([folder], runs=[run] if run else None)
    found = checks(subject)
    reasons = [one for grade in WORST_FIRST[:-1] for one in found if one.grade == grade]
    without = tuple(one.name for one in found if one.grade == "none")
    grade: Grade = reasons[0].grade if reasons else "good"
    page = folder / REPORT
    return Summary(folder, subject.last.key, grade, tuple(reasons), without, page if page.is_file() else None)


def record_grades(entries: Sequence[Entry]) -> dict[str, Any]:
    """Return how many runs have each grade, and the gravest check of each that asks for a look."""
    named = [{"run": one.name, "grade": WORDS[one.grade], "check": one.doubts[0]} for one in raised(entries)]
    return {"grades": {WORDS[grade]: n for grade, n in count_grades(entries).items()}, "look_at": named}


def say_grades(entries: Sequence[Entry]) -> None:
    """Print how many runs have each grade, and name each that asks for a look with its gravest check."""
    if entries:
        say(f"Grades: {describe_grades(entries)}")
    for one in raised(entries):
        word = WORDS[one.grade]
        say_wrapped(f"  {word}  {one.name}: {one.doubts[0]}", colour=COLOURS.get(word))
