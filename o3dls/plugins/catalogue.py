"""What stages and writers there are and what their parameters mean, as text."""

from __future__ import annotations

import inspect
from typing import Any

from ..errors import PipelineError, did_you_mean
from .parameters import Parameter, describe
from .plugin import GROUPS, Plugin, load, registered


def listing() -> str:
    """Every stage and writer with the first line of what it does."""
    lines = []
    for kind, group in GROUPS.items():
        names = sorted(registered(group))
        lines += [f"[[{kind}]] use = {name:<12} {_meaning(load(kind, name))}" for name in names]
    return "\n".join(lines)


def sheet(name: str) -> str:
    """Parameters of a stage or writer: name, default, unit, bounds or accepted words, meaning. Raises
    PipelineError.
    """
    for kind, group in GROUPS.items():
        if name in registered(group):
            plugin = load(kind, name)
            return "\n".join([f"{name}: {inspect.getdoc(plugin)}", "", *map(_line, describe(plugin))])
    raise PipelineError(
        "no stage or writer "
        f"'{name}'{did_you_mean(name, [n for group in GROUPS.values() for n in registered(group)])}"
    )


def _meaning(plugin: type[Plugin]) -> str:
    return " ".join((inspect.getdoc(plugin) or "").split("\n\n")[0].split())


def _line(p: Parameter) -> str:
    value = f"{p.name} = {as_toml(p.default)} {p.unit}".rstrip()
    return f"  {value:<34} {p.meaning} ({p.limits or p.kind})"


def as_toml(value: Any) -> str:
    """A default as a pipeline file would write it; what has none is left to be filled in."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(as_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else "(none)" if value is None else str(value)
