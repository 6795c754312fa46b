"""One entry of the strip at the top of a page, and how it is graded."""

from __future__ import annotations

from collections.abc import Mapping
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
    """A check is one entry of the strip: what is looked at, how it came out, and why in a sentence and in
    short.
    """

    name: str
    grade: Grade
    said: str
    short: str = ""
