"""Numbers of the method: each with its unit and one line of why, in frozen classes, and listed from there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

S = TypeVar("S")


@dataclass(frozen=True)
class Number:
    """This is one number of a settings class as people read it; `name` has a dot for each class around it."""

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


def with_numbers(settings: S, values: Mapping[str, Any]) -> S:
    """A copy of a settings object with other values by name; names of nested ones have dots, as in `Number`.

    Raises KeyError where there is no such number.
    """
    nested: dict[str, dict[str, Any]] = {}
    plain: dict[str, Any] = {}
    known = {one.name for one in fields(settings)}  # type: ignore[arg-type]
    for name, value in values.items():
        first, _, rest = name.partition(".")
        if first not in known:
            raise KeyError(name)
        if rest:
            nested.setdefault(first, {})[rest] = value
        else:
            plain[first] = value
    deep = {first: with_numbers(getattr(settings, first), inner) for first, inner in nested.items()}
    return replace(settings, **plain, **deep)  # type: ignore[type-var]
