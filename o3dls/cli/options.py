"""Options that several commands share, what a shell completes in them, and what is asked for where none is
given.
"""

from __future__ import annotations

import json
import logging
import re
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, get_args

import click

from ..case import PRIOR_OF
from .words import FILE

Callback = Callable[[click.Context, click.Parameter, str | None], object]
SECONDS = {"s": 1, "m": 60, "h": 3600, "d": 86400}
BYTES = {"MB": 10**6, "GB": 10**9, "MiB": 1 << 20, "GiB": 1 << 30}


def complete_stage(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
    """Complete the names of stages and writers."""
    return _matching_names(_list_plugins(), begun)


def complete_setting(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
    """Complete `STAGE.`, and behind the dot `STAGE.PARAM=`."""
    from ..plugins.parameters import describe
    from ..plugins.plugin import load

    name, dot, _ignored = begun.partition(".")
    kind = _list_plugins().get(name)
    if not dot or kind is None:
        return _matching_names((f"{one}." for one in _list_plugins()), begun)
    return _matching_names((f"{name}.{parameter.name}=" for parameter in describe(load(kind, name))), begun)


def complete_estimate(context: click.Context, _: click.Parameter, begun: str) -> list[str]:
    """Complete the estimates of the runs that are named already, which click has not told apart behind an
    option.
    """
    return _matching_names((name for run in context.args for name in _list_estimates(Path(run))), begun)


def complete_format(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
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


as_json = click.option("--json", "as_json", is_flag=True, help="print the result as JSON")
overrides = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="STAGE.PARAM=VALUE",
    shell_complete=complete_setting,
    help="override a parameter of the pipeline; may be repeated",
)


def prior_choice(command: Any) -> Any:
    """Add the options that say which surface of the prior's file is meant."""
    for option in reversed(
        (
            click.option(
                "--prior-of",
                type=click.Choice(PRIOR_OF),
                help="whose anatomy the prior is (default: patient); template: another person's or a mean",
            ),
            click.option(
                "--image",
                type=FILE,
                help="grey image that the prior was segmented in: NIfTI, NRRD, MetaImage, or a DICOM folder",
            ),
            click.option("--cap", is_flag=True, help="close the openings of the prior"),
            click.option("--label", type=int, help="label volume: the label to take"),
            click.option("--part", help="the named segment or volume of the prior"),
            click.option(
                "--box", type=float, nargs=6, help="label volume: cut to least x y z, most x y z (mm, LPS)"
            ),
            click.option(
                "--layer", "--phase", "layer", type=int, help="4D volume: the layer or phase, from 0"
            ),
            click.option("--fill-slices", is_flag=True, help="label volume: interpolate blank slices"),
            click.option(
                "--form",
                type=click.Choice(["sform", "qform"]),
                help="NIfTI whose two forms contradict: the one that is right",
            ),
            click.option(
                "--sidecar",
                type=click.Choice(["ignore", "take"]),
                help="volume that a JSON file beside it contradicts: what is done with that",
            ),
        )
    ):
        command = option(command)
    return command


def _amount_reader(units: dict[str, int], example: str) -> Callback:
    """Make a callback that reads a number above zero with its unit, as a count of the smallest unit."""

    def read(_: click.Context, __: click.Parameter, value: str | None) -> float | None:
        if value is None:
            return None
        match = re.fullmatch(r"(\d+(?:\.\d+)?) ?([A-Za-z]+)", value)
        if not match or match[2] not in units or not float(match[1]):
            known = ", ".join(units)
            raise click.BadParameter(
                f"'{value}': must be a number above 0 with one of {known} behind it, such as {example}"
            )
        return float(match[1]) * units[match[2]]

    return read


def limits(command: Any) -> Any:
    """Add the options that bound the time and the memory of a case."""
    timeout = click.option(
        "--timeout",
        callback=_amount_reader(SECONDS, "10m"),
        metavar="TIME",
        help="time limit of a case: 90s, 10m, 2h, 1d",
    )
    memory = click.option(
        "--memory",
        callback=_amount_reader(BYTES, "2GB"),
        metavar="SIZE",
        help="memory limit of a case: 800MB, 2GB, 2GiB",
    )
    return timeout(memory(command))


def progress(command: Any) -> Any:
    """Add the options of a command that takes its time: how much it says of its progress."""
    quiet = click.option(
        "-q",
        "--quiet",
        is_flag=True,
        expose_value=False,
        callback=_print_from(logging.WARNING),
        help="print only warnings and results",
    )
    verbose = click.option(
        "-v",
        "--verbose",
        is_flag=True,
        expose_value=False,
        callback=_print_from(logging.DEBUG),
        help="also print the parameters of each stage and each fit of the cross-validation",
    )
    return quiet(verbose(command))


def _print_from(level: int) -> Callable[[click.Context, click.Parameter, bool], None]:
    """Make a callback that prints the log's lines from a level on, where its option is given. The log itself
    may be listened to for more.
    """

    def heed(_: click.Context, __: click.Parameter, given: bool) -> None:
        if given:
            log = logging.getLogger("o3dls")
            log.setLevel(min(log.level, level))
            for handler in logging.getLogger().handlers:
                handler.setLevel(level)

    return heed


def ask_files(
    prior: Path | None, points: Path | None, landmarks: Path | None
) -> tuple[Path, Path, Path | None]:
    """Ask for those files of a new case that are not given."""
    missing = [f"--{name} FILE" for name, path in (("prior", prior), ("points", points)) if path is None]
    if not sys.stdin.isatty():
        raise click.UsageError(f"there is no terminal to ask on: give {' and '.join(missing)}")
    ask = partial(click.prompt, err=True, show_default=False)
    prior = prior or Path(ask("Prior: file of the surface or label volume"))
    points = points or Path(ask("Points: table with columns x, y, z and type, or a cloud"))
    if landmarks is None and (
        named := ask("Landmarks: file of places named on the prior (Enter: none)", default="")
    ):
        landmarks = Path(named)
    return prior, points, landmarks


def ask_whose() -> str:
    """Ask on the terminal whose anatomy the prior of a new case is."""
    question = "Prior: the patient's own anatomy, or a template (another person's, a mean)"
    return str(click.prompt(question, type=click.Choice(PRIOR_OF), default="patient", err=True))
