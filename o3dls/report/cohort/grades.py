"""How the runs of a cohort are graded: how many have each grade, and which ask for a look."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from ..grading.check import WORDS, Grade
from .entries import Entry

WORST_FIRST: tuple[Grade, ...] = ("bad", "amber", "good", "even", "none")


def count_grades(entries: Sequence[Entry]) -> dict[Grade, int]:
    """Return how many runs have each grade that any has, the worst first."""
    counts = Counter(one.grade for one in entries)
    return {grade: counts[grade] for grade in WORST_FIRST if counts[grade]}


def describe_grades(entries: Sequence[Entry]) -> str:
    """Return the counts as words, such as `1 FAIL, 2 CHECK, 5 OK`."""
    return ", ".join(f"{count} {WORDS[grade]}" for grade, count in count_grades(entries).items())


def raised(entries: Sequence[Entry]) -> list[Entry]:
    """Return the runs that ask for a look, the worst first."""
    return sorted((one for one in entries if one.doubts), key=lambda one: WORST_FIRST.index(one.grade))
