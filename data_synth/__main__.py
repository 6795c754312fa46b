"""Write a synthetic case folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from o3dls import Case, InputError, write_case

from . import atrium, jar, star

SEED = click.option("--seed", type=click.IntRange(min=0), default=7, show_default=True)
FORCE = click.option("--force", is_flag=True, help="replace an earlier case in the same folder")
FOLDER = click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
PERCENT = click.option(
    "--percent",
    type=click.FloatRange(0.0, 100.0),
    default=6.0,
    show_default=True,
    help="noise in percent of the points' sd",
)
SHARE = click.FloatRange(0.0, 0.9)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
def main() -> None:
    """Synthetic cases with known truth, as case folders of o3dls. The same seed gives the same case."""


@main.command("atrium")
@FOLDER
@SEED
@click.option(
    "--motion",
    type=click.FloatRange(0.0, 3.0),
    default=1.0,
    show_default=True,
    help="non-rigid motion; 1 is typical",
)
@click.option("--noise", type=click.FloatRange(min=0.0), help="sd per axis in mm; default: drawn from 1 to 2")
@click.option("--points", type=click.IntRange(min=10), default=250, show_default=True, help="mapping points")
@click.option(
    "--outliers", type=SHARE, help="share of the points inside the chamber; default: drawn from 0.05 to 0.10"
)
@click.option(
    "--unseen", type=SHARE, help="share of the wall without points; default: drawn from 0.15 to 0.25"
)
@click.option(
    "--lacks",
    type=click.Choice(["neither", "prior", "truth"]),
    default="neither",
    show_default=True,
    help="which surface lacks a vein that the other has",
)
@click.option(
    "--beside",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="points more, of the other atrium",
)
@FORCE
def _atrium(folder: Path, force: bool, **options: Any) -> None:
    """A left atrium that moved between imaging and mapping."""
    _write(folder, atrium(**options), force)


@main.command("jar")
@FOLDER
@SEED
@PERCENT
@FORCE
def _jar(folder: Path, seed: int, percent: float, force: bool) -> None:
    """A jar of 60 x 60 x 80 mm."""
    _write(folder, jar(seed, percent=percent), force)


@main.command("star")
@FOLDER
@SEED
@PERCENT
@FORCE
def _star(folder: Path, seed: int, percent: float, force: bool) -> None:
    """A five-pointed star in the plane."""
    _write(folder, star(seed, percent=percent), force)


def _write(folder: Path, case: Case, force: bool) -> None:
    try:
        write_case(folder, case, force=force)
    except InputError as error:
        raise click.ClickException(str(error)) from None
    click.echo(f"{folder}: {case.notes}")


if __name__ == "__main__":
    main(prog_name="python -m data_synth")
