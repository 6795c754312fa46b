"""The first lines of a page: the grade of the whole, and the checks in a row, short; their sentences stand
in the outcome.
"""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import shorten

from .checks import WORDS, Check, Grade
from .markup import Html, tag

WORST_FIRST: tuple[Grade, ...] = ("bad", "amber")
LETTERS = 110  # of the warnings in the first lines: two lines of a telephone


def overall(found: Sequence[Check], warnings: Sequence[str]) -> Html:
    """The worst grade of the checks, which of them have it, and the beginning of the warnings."""
    raised = [one for grade in WORST_FIRST for one in found if one.grade == grade]
    grade: Grade = raised[0].grade if raised else "good"
    said = "; ".join(f"{one.name}: {one.short or one.said}" for one in raised)
    return tag(
        "p",
        tag("strong", WORDS[grade], class_="grade"),
        f" {said or _passed(found)}. ",
        _told(warnings),
        class_=f"overall {grade}",
    )


def _passed(found: Sequence[Check]) -> str:
    """What OK rests on: a check without data proves nothing."""
    without = sum(one.grade == "none" for one in found)
    return f"{len(found) - without} checks passed" + (f", {without} without data" if without else "")


def _told(warnings: Sequence[str]) -> Html | None:
    if not warnings:
        return None
    count = f"{len(warnings)} warning{'' if len(warnings) == 1 else 's'}"
    text = shorten("; ".join(one.rstrip(".") for one in warnings), LETTERS, placeholder=" …")
    return tag("span", tag("a", count, href="#outcome"), f": {text}")


def strip(found: Sequence[Check], name: str) -> Html:
    """The checks of what that name says side by side; the grade stands there as a word, so no colour is
    needed to read it.
    """
    items = (
        tag(
            "li",
            tag("b", one.name),
            tag("span", WORDS[one.grade], class_="grade"),
            tag("span", one.short) if one.short else None,
            class_=one.grade,
            title=one.said,
        )
        for one in found
    )
    return tag("ul", *items, class_="strip", aria_label=f"Quality of the fused {name}")
