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


def count_decimals(value: float, limits: Sequence[float], usual: int) -> int:
    """Return how many decimals a value and its limits need so that one that is beyond a limit does not look
    equal to it: the usual number, or up to three more.
    """
    for digits in range(usual, usual + 3):
        if all(value == one or round(value, digits) != round(one, digits) for one in limits):
            return digits
    return usual + 3


def write_share(value: float, *limits: float, usual: int = 0) -> str:
    """Write a share in percent, told apart from its limits."""
    percent = [100.0 * one for one in (value, *limits)]
    return f"{percent[0]:.{count_decimals(percent[0], percent[1:], usual)}f}%"


def count_words(found: Sequence[str], word: str) -> str:
    """Write how many there are of what a word names."""
    return f"{len(found)} {word}{'' if len(found) == 1 else 's'}"
