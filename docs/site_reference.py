"""The parts of the reference that the code tells when the site is built, as Markdown."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from textwrap import indent
from typing import Any

import click

import o3dls
from o3dls.cli.commands import cli
from o3dls.errors import O3dlsError
from o3dls.plugins.catalogue import table
from o3dls.plugins.help import words
from o3dls.runs.writers import Writer


def commands() -> str:
    """Every command with its usage, what it does, and its options."""
    context = click.Context(cli, info_name="o3dls")
    return "\n\n".join(_command(context, cli.commands[name]) for name in sorted(cli.commands))


def _command(parent: click.Context, command: click.Command) -> str:
    context = click.Context(command, info_name=command.name, parent=parent)
    usage = command.get_usage(context).removeprefix("Usage: ")
    rows = [row for one in command.params if (row := one.get_help_record(context)) and row[1]]
    options = [f"| `{_cell(name)}` | {_cell(meaning)} |" for name, meaning in rows]
    options[:0] = ["", "| option | meaning |", "|---|---|"] if options else []
    head = f"## o3dls {command.name}\n\n{inspect.cleandoc(command.help or '')}"
    return "\n".join([head, "", "```text", usage, "```", *options])


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|")


def api() -> str:
    """Every public name of o3dls, by kind, with its docstring."""
    return "\n\n".join(f"## {kind}\n\n{''.join(map(_name, names))}" for kind, names in kinds())


def kinds() -> Iterator[tuple[str, list[str]]]:
    """The public names by kind: stages, writers, errors, other classes, functions."""
    found: dict[str, list[str]] = {
        kind: [] for kind in ("Functions", "Classes", "Stages", "Writers", "Errors")
    }
    for name in o3dls.PUBLIC:
        found[_kind(getattr(o3dls, name))].append(name)
    yield from found.items()


def _kind(thing: Any) -> str:
    if not inspect.isclass(thing):
        return "Functions"
    for parent, kind in ((O3dlsError, "Errors"), (o3dls.Stage, "Stages"), (Writer, "Writers")):
        if issubclass(thing, parent):
            return kind
    return "Classes"


def _name(name: str) -> str:
    """The directive of a name; parameters of a stage or writer as the table that help has too."""
    thing = getattr(o3dls, name)
    plugin = getattr(thing, "name", None) if _kind(thing) in ("Stages", "Writers") else None
    if plugin:
        head, body = f"py:class:: o3dls.{name}(**parameters)", f"\n{indent(words(thing), '   ')}\n"
    else:
        head, body = f"auto{'class' if inspect.isclass(thing) else 'function'}:: o3dls.{name}", ""
    options = "   :members:\n" if head.startswith("autoclass") else ""
    text = f"### {name}\n\n```{{eval-rst}}\n.. {head}\n{options}{body}```\n\n"
    return text + (f"{table(plugin)}\n\n" if plugin else "")


PARTS = {"commands": commands, "api": api}
