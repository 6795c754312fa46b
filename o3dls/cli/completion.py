"""What a shell completes beyond files: names of stages, parameters, estimates, formats and packages."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import get_args

import click


def stages(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
    """Complete the names of stages and writers."""
    return _matching_names(_list_plugins(), begun)


def settings(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
    """Complete `STAGE.`, and behind the dot `STAGE.PARAM=`."""
    from ..plugins.parameters import describe
    from ..plugins.plugin import load

    name, dot, _ignored = begun.partition(".")
    kind = _list_plugins().get(name)
    if not dot or kind is None:
        return _matching_names((f"{one}." for one in _list_plugins()), begun)
    return _matching_names((f"{name}.{parameter.name}=" for parameter in describe(load(kind, name))), begun)


def estimates(context: click.Context, _: click.Parameter, begun: str) -> list[str]:
    """Complete the estimates of the runs that are named already, which click has not told apart behind an
    option.
    """
    return _matching_names((name for run in context.args for name in _list_estimates(Path(run))), begun)


def formats(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
    """Complete the formats of exported files."""
    from ..runs.export.formats import FormatName

    return _matching_names(get_args(FormatName), begun)


def _matching_names(names: Iterable[str], begun: str) -> list[str]:
    return sorted({name for name in names if name.startswith(begun)})


def _list_plugins() -> dict[str, str]:
    """Return kinds of stages and writers by their names."""
    from ..plugins.plugin import GROUPS, registered

    return {name: kind for kind, group in GROUPS.items() for name in registered(group)}


def _list_estimates(run: Path) -> list[str]:
    """List the estimates of a run; none of what is no run, since a shell has no place for errors."""
    try:  # a checked record would take half a second more
        return list(json.loads((run / "run.json").read_text(encoding="utf-8"))["estimates"])
    except (OSError, ValueError, LookupError, TypeError):
        return []
