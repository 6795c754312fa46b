"""One entry of the strip at the top of a page, and how it is graded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

# `even`: there are data, and they speak neither for the surface nor against it
Grade = Literal["good", "even", "amber", "bad", "none"]
WORDS: Mapping[Grade, str] = {
    "good": "OK",
    "even": "NEUTRAL",
    "amber": "CHECK",
    "bad": "FAIL",
    "none": "NO DATA",
}


@dataclass(frozen=True)
class Check:
    """A check is one entry of the strip: what is looked at, how it came out, why in a sentence and in short,
    and what would be OK (empty where nothing could be graded).
    """

    name: str
    grade: Grade
    said: str
    short: str = ""
    limit: str = ""


def doubtful(found: Sequence[Check]) -> list[Check]:
    """Return the checks that ask for a look, the worst first."""
    return [one for grade in ("bad", "amber") for one in found if one.grade == grade]


def worst_grade(found: Sequence[Check]) -> Grade:
    """Return the grade of all checks together: the worst of those that ask for a look, else good."""
    raised = doubtful(found)
    return raised[0].grade if raised else "good"


def count_words(found: Sequence[str], word: str) -> str:
    """Write how many there are of what a word names."""
    return f"{len(found)} {word}{'' if len(found) == 1 else 's'}"
