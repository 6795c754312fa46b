"""How it came out: short, for the first lines of the page, and whole, with every check in a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate

from ..checks import WARNINGS, checks
from ..grading.check import WORDS, Check, Grade, doubtful, worst_grade
from ..grading.remarks import Remark, count_remarks, notes_of, remarks, warnings_of
from ..markup import Html, join, tag
from ..section import Section
from ..subject import Subject
from ..verdict import verdict
from ..wall_parts import parts_table

MEANINGS: Mapping[Grade, str] = {
    "good": "No check found a problem",
    "amber": "Look at this before you use the surface",
    "bad": "Do not use the surface before you know why",
}
NOTES = "Notes"
LETTERS = 110  # two lines on a telephone, from which on no further remark stands at the top of the page


def overall(found: Sequence[Check], told: Sequence[Remark]) -> Html:
    """Show the worst grade of the checks, which of them have it, and the first remarks."""
    raised, grade = doubtful(found), worst_grade(found)
    said = "; ".join(map(_shorten_check, (one for one in raised if one.name != WARNINGS)))
    rests_on = said if raised else _count_passed(found)
    return tag(
        "p",
        tag("strong", WORDS[grade], class_="grade"),
        f" {MEANINGS[grade]}{': ' if rests_on else ''}{rests_on}. ",
        _begin_remarks(told),
        class_=f"overall {grade}",
    )


def _shorten_check(one: Check) -> str:
    limit = f" ({WORDS['good']} {one.limit})" if one.limit else ""
    return f"{one.name}: {one.short or one.said}{limit}"


def _count_passed(found: Sequence[Check]) -> str:
    """Say how many checks passed, and how many did not: one that found no difference, or no data, proves
    nothing.
    """
    grades = [one.grade for one in found]
    kinds = (("good", "{} checks passed"), ("even", "{} neutral"), ("none", "{} without data"))
    return ", ".join(text.format(grades.count(kind)) for kind, text in kinds if kind in grades)


def _begin_remarks(told: Sequence[Remark]) -> Html | None:
    """Count the remarks, with the first whole ones: warnings, or notes where there are no others. A link
    leads to the rest.
    """
    if not told:
        return None
    first, where = (grave, WARNINGS) if (grave := warnings_of(told)) else (told, NOTES)
    fitting = sum(end <= LETTERS for end in accumulate(len(one.sentence) for one in first))
    shown = [_end_sentence(one.sentence) for one in first[: max(1, fitting)]]
    more = len(told) - len(shown)
    link = tag("a", f"And {more} more", href=f"#{where.lower()}")
    return tag("span", f"{count_remarks(told)}: {' '.join(shown)} ", join(link, ".") if more else None)


def _end_sentence(text: str) -> str:
    return text if text.endswith(("?", ".")) else f"{text}."


def strip(found: Sequence[Check], name: str) -> Html:
    """List the checks side by side, under the `name` of what they judge; each grade stands there as a word,
    so no colour is needed to read it.
    """
    items = (
        tag(
            "li",
            tag("b", one.name),
            tag("span", WORDS[one.grade], class_="grade"),
            tag("span", one.short) if one.short else None,
            _name_limit(one),
            class_=one.grade,
            title=one.said,
        )
        for one in found
    )
    return tag("ul", *items, class_="strip", aria_label=f"Quality of the fused {name}")


def outcome_section(subject: Subject) -> Section:
    """Show the verdict, every check and every remark in full; the head of the page shortens them."""
    told = remarks(subject)
    body = join(
        tag("p", verdict(subject), class_="verdict"),
        parts_table(subject),
        tag("ul", *map(_check_item, checks(subject)), class_="checks", aria_label="Checks"),
        _list_remarks(warnings_of(told), WARNINGS),
        _list_remarks(notes_of(told), NOTES),
    )
    return Section("outcome", "Outcome", body)


def _list_remarks(told: Sequence[Remark], name: str) -> Html | None:
    items = [tag("li", one.sentence) for one in told]
    anchor = name.lower()
    return tag("ul", *items, id=anchor, class_=anchor, aria_label=name) if items else None


def _check_item(one: Check) -> Html:
    grade = tag("span", WORDS[one.grade], class_="grade")
    return tag("li", tag("b", one.name), grade, tag("span", one.said), _name_limit(one), class_=one.grade)


def _name_limit(one: Check) -> Html | None:
    return tag("small", f"{WORDS['good']} {one.limit}", class_="soft") if one.limit else None
