"""Commands about the program: `settings`, the numbers of the method as Markdown tables, taken from the
settings classes; `names`; `doctor`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, fields, is_dataclass
from importlib import import_module
from typing import Any

import click

from ..errors import InputError, did_you_mean
from ..settings import Number, numbers
from .options import as_json, progress
from .words import DONE, NOT_VALID, say, say_json, say_lines

# The classes of each package's module `settings`, or of that of a package in it. Each holds those of its
# parts.
CLASSES = {
    "noise": ("ContactSettings", "MixtureSettings", "DuplicateSettings", "CurvedWallSettings"),
    "motion": ("MotionSettings", "TemplateSettings", "off_wall.OffWallSettings", "wall.WallSettings"),
    "levelset": ("LatticeSettings", "PaperSettings"),
    "reconstruction": ("ReconstructionSettings",),
    "topology": ("TopologySettings",),
}


@click.command()
@click.argument(
    "package",
    required=False,
    shell_complete=lambda _, __, begun: [name for name in CLASSES if name.startswith(begun)],
)
def settings(package: str | None) -> None:
    """Print the numbers of the method with unit and reason: all, or those of PACKAGE (noise, motion, ...)."""
    say_lines("\n\n".join(tables(name) for name in ([package] if package else CLASSES)))


def tables(package: str) -> str:
    """Write the numbers of a package as Markdown, a table for each class. Raises InputError."""
    if package not in CLASSES:
        raise InputError(f"no settings of a package '{package}'{did_you_mean(package, list(CLASSES))}")
    found = [name.rpartition(".") for name in CLASSES[package]]
    modules = [
        import_module(".".join(filter(None, ("o3dls", package, part, "settings")))) for part, _, _ in found
    ]
    classes = [getattr(module, name) for module, (_, _, name) in zip(modules, found, strict=True)]
    return "\n\n".join(text for one in classes for text in _write_tables(one()))


def _write_tables(settings: Any, prefix: str = "") -> Iterator[str]:
    """Write a table of a class's own numbers, then those of the classes that it holds.

    Of a class that another package owns only the numbers that differ from its defaults are shown: no number
    stands twice.
    """
    nested = [one.name for one in fields(settings) if is_dataclass(getattr(settings, one.name))]
    every = list(numbers(settings, prefix))
    own = [one for one in every if one.name.removeprefix(prefix).partition(".")[0] not in nested]
    yield f"{_class_title(settings, prefix)}" + (f"\n\n{_write_table(own)}" if own else "")
    for name in nested:
        inner = getattr(settings, name)
        if _owner_package(inner) == _owner_package(settings):
            yield from _write_tables(inner, f"{prefix}{name}.")
        else:
            yield _describe_borrowed(inner, f"{prefix}{name}.")


def _describe_borrowed(settings: Any, prefix: str) -> str:
    """Say where the numbers of another package's class stand, and which of them are others here."""
    usual = {one.name: one.value for one in numbers(type(settings)(), prefix)}
    other = [one for one in numbers(settings, prefix) if one.value != usual[one.name]]
    kind, owner = type(settings).__name__, _owner_package(settings)
    where = f"**`{prefix}*`**: the numbers of `{kind}`, as `o3dls settings {owner}` prints them"
    return f"{where}, but for\n\n{_write_table(other)}" if other else f"{where}."


def _class_title(settings: Any, prefix: str) -> str:
    """Return the name of a class and what it is for."""
    meaning = " ".join((type(settings).__doc__ or "").split("\n\n")[0].split())
    where = f" (`{prefix}*`)" if prefix else ""
    return f"**`{type(settings).__name__}`**{where}: {meaning}"


def _write_table(rows: list[Number]) -> str:
    lines = [f"| `{one.name}` | {_write_value(one.value)} | {one.unit} | {one.why} |" for one in rows]
    return "\n".join(["| name | value | unit | why |", "|---|---|---|---|", *lines])


def _write_value(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_write_value, value)) or "none"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _owner_package(settings: Any) -> str:
    """Return the package that owns a class."""
    return type(settings).__module__.split(".")[1]


@click.command()
@click.argument("what", type=click.Choice(["columns", "quantities", "tags", "places"]))
def names(what: str) -> None:
    """Print which headings of tables, values, tags of points or names of places mean what, as a table."""
    from ..io.mapping.name_tables import TABLES

    say_lines("\n".join(TABLES[what]()))


@click.command()
@click.option("--compile", "compiles", is_flag=True, help="compile all loops now, and check nothing")
@as_json
@progress
def doctor(compiles: bool, as_json: bool) -> int:
    """Check this machine, and say how to fix each fault; or compile the loops of a new installation, which
    the first run would do else.
    """
    from .doctor import compile_loops, diagnose

    if compiles:
        seconds = compile_loops()
        say_json({"seconds": seconds}) if as_json else say(f"compiled in {seconds:.0f} s")
        return DONE
    checks = diagnose()
    if as_json:
        say_json(list(map(asdict, checks)))
    else:
        for check in checks:
            say_lines(check)
    return DONE if all(check.ok for check in checks if check.needed) else NOT_VALID
