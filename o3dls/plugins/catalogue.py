"""What stages and writers there are and what their parameters mean, as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..errors import PipelineError, did_you_mean
from .help import words
from .parameters import Parameter, describe
from .plugin import GROUPS, Plugin, load, registered
from .stage import Stage


def listing() -> str:
    """Return every stage and writer with the first line of what it does."""
    lines = []
    for kind, group in GROUPS.items():
        names = sorted(registered(group))
        lines += [f"[[{kind}]] use = {name:<12} {meaning(load(kind, name))}" for name in names]
    return "\n".join(lines)


def sheet(name: str) -> str:
    """Return parameters of a stage or writer: name, default, unit, bounds or accepted words, meaning. Raises
    PipelineError.
    """
    plugin = _find_plugin(name)
    return "\n".join([f"{name}: {words(plugin)}", "", *map(_format_line, describe(plugin))])


def tables() -> str:
    """Return the parameters of every stage and writer that has any, as Markdown tables."""
    names = [name for group in GROUPS.values() for name in sorted(registered(group))]
    return "\n\n".join(table(name) for name in names if _own_parameters(_find_plugin(name)))


def table(name: str) -> str:
    """Return the parameters of a stage or writer, but for those that all stages have, as a Markdown table.
    Raises PipelineError.
    """
    rows = map(_format_row, _own_parameters(_find_plugin(name)))
    return "\n".join([f"| `{name}` | default | bounds | meaning |", "|---|---|---|---|", *rows])


def commented(name: str, keys: Sequence[str]) -> list[tuple[str, str]]:
    """Return some parameters of a stage or writer, each at its default as a pipeline file writes it, and its
    unit, meaning and bounds. Raises PipelineError.
    """
    known = {p.name: p for p in describe(_find_plugin(name))}
    return [
        (f"{p.name} = {as_toml(p.default)}", _describe_parameter(p)) for p in map(known.__getitem__, keys)
    ]


def _describe_parameter(p: Parameter) -> str:
    unit = f"{p.unit}: " if p.unit else ""
    return f"{unit}{p.meaning} ({p.limits or p.kind})"


def _find_plugin(name: str) -> type[Plugin]:
    """Return the stage or writer of a name."""
    for kind, group in GROUPS.items():
        if name in registered(group):
            return load(kind, name)
    raise PipelineError(
        "no stage or writer "
        f"'{name}'{did_you_mean(name, [n for group in GROUPS.values() for n in registered(group)])}"
    )


def _own_parameters(plugin: type[Plugin]) -> list[Parameter]:
    """Return the parameters of a stage or writer, but for those that all stages have."""
    common = {p.name for p in describe(Stage)}
    return [p for p in describe(plugin) if p.name not in common]


def meaning(plugin: type[Plugin]) -> str:
    """Return what a stage or writer does: the first paragraph of its docstring, on one line."""
    return " ".join(words(plugin).split("\n\n")[0].split())


def _format_line(p: Parameter) -> str:
    value = f"{p.name} = {as_toml(p.default)} {p.unit}".rstrip()
    return f"  {value:<34} {p.meaning} ({p.limits or p.kind})"


def _format_row(p: Parameter) -> str:
    value = f"`{as_toml(p.default)}` {p.unit}".rstrip()
    return f"| `{p.name}` | {value} | {p.limits or p.kind} | {p.meaning} |"


def as_toml(value: Any) -> str:
    """Return a default as a pipeline file would write it; what has none is left to be filled in."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(as_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else "(none)" if value is None else str(value)
