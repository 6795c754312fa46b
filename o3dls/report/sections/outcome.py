"""The outcome in words: the verdict, the parts of the wall, every check in a sentence, and the warnings."""

from __future__ import annotations

from ..checks import WORDS, Check, checks
from ..markup import Html, join, tag
from ..subject import Subject
from ..verdict import verdict, warnings
from ..wall_parts import parts_table
from .section import Section


def outcome_section(subject: Subject) -> Section:
    """What the strip above the pictures says in short, whole."""
    said = warnings(subject)
    body = join(
        tag("p", verdict(subject), class_="verdict"),
        parts_table(subject),
        tag("ul", *map(_sentence, checks(subject)), class_="checks", aria_label="Checks"),
        tag("ul", *(tag("li", text) for text in said), class_="warnings", aria_label="Warnings")
        if said
        else None,
    )
    return Section("outcome", "Outcome", body)


def _sentence(one: Check) -> Html:
    grade = tag("span", WORDS[one.grade], class_="grade")
    return tag("li", tag("b", one.name), grade, tag("span", one.said), class_=one.grade)
