"""Numbers of the method: each with its unit and one line of why, in frozen classes, and listed from there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any


@dataclass(frozen=True)
class Number:
    """One number of a settings class as people read it; `name` has a dot for each class around it."""

    name: str
    value: Any
    unit: str
    why: str


def number(default: Any, unit: str, why: str) -> Any:
    """A field of a settings class: its default, its unit ("" for counts, "1" for pure numbers), and why."""
    return field(default=default, metadata={"unit": unit, "why": why})


def numbers(settings: Any, prefix: str = "") -> Iterator[Number]:
    """Every number of a settings object, those of nested settings behind their field's name and a dot."""
    for one in fields(settings):
        value = getattr(settings, one.name)
        if is_dataclass(value):
            yield from numbers(value, f"{prefix}{one.name}.")
        else:
            yield Number(prefix + one.name, value, one.metadata["unit"], one.metadata["why"])
