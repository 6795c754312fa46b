"""What a plugin's parameters are (for help) and what is wrong with given ones (for errors), both read off its
pydantic model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from ..errors import did_you_mean


@dataclass(frozen=True)
class Parameter:
    """A parameter is described as people read it: `limits` is an interval such as `[0, inf)` or the accepted
    words.
    """

    name: str
    kind: str
    default: Any
    unit: str
    limits: str
    meaning: str


def describe(plugin: type[BaseModel]) -> list[Parameter]:
    """Return the parameters of a plugin in the order of its class; those of a part as `part.name`."""
    found = list[Parameter]()
    for name, field in plugin.model_fields.items():
        inner = part(field)
        own = [described(name, field)] if inner is None else _describe_part(name, inner)
        found += own
    return found


def part(field: FieldInfo) -> type[BaseModel] | None:
    """Return the class of a parameter that is a table of parameters itself, such as `deform` in `phases`."""
    kind = field.annotation
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None


def parameter_error(model: BaseModel, name: str, words: str) -> PydanticCustomError:
    """Return an error, for validators of a whole plugin, that says what is wrong with one of its parameters,
    given the others.
    """
    about = {"name": name, "value": getattr(model, name), "words": words}
    return PydanticCustomError("parameter", "a parameter does not fit the others", about)


def unfitting(model: BaseModel, name: str, condition: str) -> None:
    """Raise where a parameter that has no effect under some condition (in words) is not at its default."""
    if getattr(model, name) != type(model).model_fields[name].get_default(call_default_factory=True):
        raise parameter_error(model, name, f"has no effect {condition}")


def described(name: str, f: FieldInfo) -> Parameter:
    """Return a parameter by its field."""
    default = f.get_default(call_default_factory=True)
    return Parameter(
        f.alias or name, _describe_kind(f), default, _shown_unit(f), _describe_limits(f), f.description or ""
    )


def _describe_part(name: str, inner: type[BaseModel]) -> list[Parameter]:
    placing = getattr(inner, "placing", ())
    own = [described(key, field) for key, field in inner.model_fields.items() if key not in placing]
    return [replace(one, name=f"{name}.{one.name}") for one in own]


def mistakes(plugin: type[BaseModel], error: ValidationError) -> list[str]:
    """Return one sentence per mistake, such as `icp.tolerance = -1.0 mm: must be a number within [0, inf)
    mm`.
    """
    owner = str(getattr(plugin, "name", plugin.__name__))
    details = error.errors(include_url=False)
    # a list with a wrong entry is also reported as too short
    inside = {detail["loc"][0] for detail in details if len(detail["loc"]) > 1}
    kept = [detail for detail in details if len(detail["loc"]) != 1 or detail["loc"][0] not in inside]
    return list(dict.fromkeys(one for detail in kept for one in _describe_mistakes(plugin, owner, detail)))


def as_written(value: Any, field: FieldInfo) -> bool:
    """Return whether a value, or each entry of a list or table, is of the kind that it would be taken for:
    number, yes or no, something else.
    """
    kinds = set(_flatten_annotation(field.annotation)) - {type(None), Ellipsis}
    if not kinds or not kinds <= {bool, int, float}:
        return True
    entries = (
        value.values()
        if isinstance(value, Mapping)
        else value
        if isinstance(value, list | tuple)
        else [value]
    )
    return all(_is_of_kinds(entry, kinds) for entry in entries)


def _is_of_kinds(entry: Any, kinds: set[Any]) -> bool:
    if isinstance(entry, bool):
        return bool in kinds
    return kinds != {bool} if isinstance(entry, int | float) else not isinstance(entry, str | bytes)


def _describe_mistakes(plugin: type[BaseModel], owner: str, detail: ErrorDetails) -> list[str]:
    """Return one sentence, or one per mistake in a part."""
    about = detail.get("ctx", {})
    if detail["type"] == "part":
        return [f"{owner}.{mistake}" for mistake in about["mistakes"]]
    if detail["type"] == "parameter":
        field = plugin.model_fields[about["name"]]
        value = _show_value(about["value"], _shown_unit(field))
        return [f"{owner}.{field.alias or about['name']} = {value}: {about['words']}"]
    return [_describe_mistake(plugin, owner, detail)]


def _describe_mistake(plugin: type[BaseModel], owner: str, detail: ErrorDetails) -> str:
    fields = {f.alias or name: f for name, f in plugin.model_fields.items()}
    key = str(detail["loc"][0]) if detail["loc"] else ""
    if detail["type"] == "extra_forbidden":
        return f"{owner}.{key}: no such parameter{did_you_mean(key, list(fields))}"
    key = next((f.alias for name, f in plugin.model_fields.items() if name == key and f.alias), key)
    if detail["type"] == "missing":
        return f"{owner}.{key}: is missing; it has no default"
    message = detail["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
    if key not in fields:
        return f"{owner}: {message}"
    field = fields[key]
    words = _accepted_words(fields[key])
    entry = len(detail["loc"]) > 1 and get_origin(field.annotation) in (tuple, list, dict)
    place = f"{key}[{detail['loc'][1]!r}]" if entry else key
    given = f"{owner}.{place} = {_show_value(detail['input'], _shown_unit(field))}"
    if words and isinstance(detail["input"], str):
        return f"{given}{did_you_mean(detail['input'], words)}"
    own_words = entry or detail["type"] == "value_error"
    return f"{given}: {message if own_words else f'must be {_describe_wanted(field)}'}"


def _show_value(value: Any, unit: str) -> str:
    plain = list(value) if isinstance(value, tuple) else value
    return repr(value).lower() if isinstance(value, bool) else f"{plain!r} {unit}".rstrip()


def _describe_wanted(field: FieldInfo) -> str:
    """Return in words what would be right."""
    limits, unit, kind = _describe_limits(field), _shown_unit(field), _describe_kind(field)
    if _accepted_words(field):
        return f"one of {limits}"
    kind = kind if kind.startswith("true") else f"a {kind}"
    return f"{kind} within {limits} {unit}".rstrip() if limits.startswith(("[", "(")) else limits or kind


def _shown_unit(field: FieldInfo) -> str:
    """Return the unit to show; a pure number (`1`) shows none."""
    extra = field.json_schema_extra
    unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
    return "" if unit == "1" else unit


def _accepted_words(field: FieldInfo) -> list[str]:
    """Return the accepted words of a Literal, also inside a union or a tuple."""
    return [
        word
        for part in _flatten_annotation(field.annotation)
        if get_origin(part) is Literal
        for word in get_args(part)
        if isinstance(word, str)
    ]


def _flatten_annotation(annotation: Any) -> list[Any]:
    if get_origin(annotation) in (Union, UnionType, tuple, list):
        return [deep for part in get_args(annotation) for deep in _flatten_annotation(part)]
    if get_origin(annotation) is dict:
        return _flatten_annotation(get_args(annotation)[1])
    if get_origin(annotation) is Annotated:
        return _flatten_annotation(get_args(annotation)[0])
    return [annotation]


def _describe_kind(field: FieldInfo) -> str:
    names = {
        bool: "true or false",
        int: "whole number",
        float: "number",
        str: "text",
        Path: "path",
        type(None): "",
        Ellipsis: "",
    }
    if part(field):
        return "table of parameters"
    parts = [
        "word" if get_origin(p) is Literal else names.get(p, getattr(p, "__name__", str(p)))
        for p in _flatten_annotation(field.annotation)
    ]
    kind = " or ".join(dict.fromkeys(filter(None, parts)))
    if get_origin(field.annotation) is dict:
        return f"{kind} per name"
    if get_origin(field.annotation) not in (tuple, list):
        return kind
    bounds = [
        f", {word} {getattr(m, name)}"
        for name, word in (("min_length", "at least"), ("max_length", "at most"))
        for m in field.metadata
        if getattr(m, name, None)
    ]
    return f"list of {kind}s{''.join(bounds)}"


def _describe_limits(field: FieldInfo) -> str:
    """Return `[low, high]`, with round brackets where a bound is excluded, as infinity is; the accepted
    words, a pattern, or nothing.
    """
    if words := _accepted_words(field):
        return ", ".join(words)
    known = ("ge", "gt", "le", "lt", "pattern")
    bounds = {
        name: getattr(m, name) for m in field.metadata for name in known if getattr(m, name, None) is not None
    }
    if "pattern" in bounds:
        return f"text that matches {bounds['pattern']}"
    if not bounds:
        return ""
    low = f"({bounds['gt']:g}" if "gt" in bounds else (f"[{bounds['ge']:g}" if "ge" in bounds else "(-inf")
    high = f"{bounds['lt']:g})" if "lt" in bounds else (f"{bounds['le']:g}]" if "le" in bounds else "inf)")
    return f"{low}, {high}"
