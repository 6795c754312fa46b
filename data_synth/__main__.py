"""Write a synthetic case folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import Any

import click

from o3dls import Case, InputError, write_case

from . import Mapping, atrium, cross, family, jar, read_wall, roughened, star, study, write_study
from .carto import write_carto_study
from .families import FAMILIES
from .grey import write_enhanced

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
SURFACE = click.Path(exists=True, dir_okay=False, path_type=Path)


def _noise(_: click.Context, __: click.Parameter, value: str) -> float | None:
    """A length in mm, or None for `per-point`."""
    try:
        found = None if value == "per-point" else float(value)
    except ValueError:
        found = -1.0
    if found is not None and not found >= 0.0:
        raise click.BadParameter(f"'{value}': must be a length in mm, 0 or more, or per-point")
    return found


MAPPING = (
    click.option(
        "--points", type=click.IntRange(min=10), default=250, show_default=True, help="mapping points"
    ),
    click.option(
        "--noise",
        callback=_noise,
        metavar="MM|per-point",
        default="1.0",
        show_default=True,
        help="sd per axis in mm, or one of 0.5 to 2 mm for each point",
    ),
    click.option(
        "--clustered/--even",
        default=True,
        show_default=True,
        help="clustered points and a quarter of the wall unseen, or even ones",
    ),
    click.option("--outliers", type=SHARE, default=0.0, show_default=True, help="share of the points inside"),
    click.option("--sigma", "told", is_flag=True, help="write each point's noise as column sigma"),
    click.option(
        "--landmarks/--no-landmarks", default=True, show_default=True, help="four places, or init.csv"
    ),
    click.option(
        "--reach",
        type=click.FloatRange(min=0.0),
        default=1.9,
        show_default=True,
        help="vessels are cut so many radii from the centre; 0: nowhere",
    ),
)


def mapping(command: Callable[..., None]) -> Callable[..., None]:
    """The options of how a real wall is mapped."""
    return reduce(lambda found, option: option(found), reversed(MAPPING), command)


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
@click.option(
    "--prior-noise",
    type=click.FloatRange(min=0.0),
    default=0.0,
    show_default=True,
    help="sd per axis in mm of every vertex of the prior, as of a rough segmentation",
)
@FORCE
def _atrium(folder: Path, force: bool, prior_noise: float, **options: Any) -> None:
    """A left atrium that moved between imaging and mapping."""
    _write(folder, lambda: roughened(atrium(**options), prior_noise, options["seed"]), force)


@main.command("jar")
@FOLDER
@SEED
@PERCENT
@FORCE
def _jar(folder: Path, seed: int, percent: float, force: bool) -> None:
    """A jar of 60 x 60 x 80 mm."""
    _write(folder, lambda: jar(seed, percent=percent), force)


@main.command("star")
@FOLDER
@SEED
@PERCENT
@FORCE
def _star(folder: Path, seed: int, percent: float, force: bool) -> None:
    """A five-pointed star in the plane."""
    _write(folder, lambda: star(seed, percent=percent), force)


@main.command("family")
@FOLDER
@click.option("--prior", type=SURFACE, required=True, help="a closed surface")
@click.option(
    "--family",
    "name",
    type=click.Choice(list(FAMILIES)),
    default="flow",
    show_default=True,
    help="what kind of motion",
)
@SEED
@click.option(
    "--motion",
    type=click.FloatRange(0.0, 3.0, min_open=True),
    default=1.0,
    show_default=True,
    help="1 leaves 1.0 to 1.8 mm rms after the best similarity",
)
@mapping
@FORCE
def _family(
    folder: Path,
    prior: Path,
    name: str,
    seed: int,
    motion: float,
    landmarks: bool,
    reach: float,
    force: bool,
    **how: Any,
) -> None:
    """A real atrium that moved by a motion unlike any that the program expects."""

    def made() -> Case:
        rest = read_wall(prior, reach or None)
        return family(rest, seed, family=name, motion=motion, landmarks=landmarks, how=Mapping(**how))

    _write(folder, made, force)


@main.command("cross")
@FOLDER
@click.option("--prior", type=SURFACE, required=True, help="a closed surface")
@click.option("--truth", type=SURFACE, required=True, help="another one, which is mapped")
@SEED
@mapping
@FORCE
def _cross(
    folder: Path,
    prior: Path,
    truth: Path,
    seed: int,
    landmarks: bool,
    reach: float,
    force: bool,
    **how: Any,
) -> None:
    """A real atrium as the prior of another person's."""

    def made() -> Case:
        one, other = (read_wall(path, reach or None) for path in (prior, truth))
        return cross(one, other, seed, landmarks=landmarks, how=Mapping(**how))

    _write(folder, made, force)


@main.command("enhanced")
@FOLDER
@SEED
@FORCE
def _enhanced(folder: Path, seed: int, force: bool) -> None:
    """The atrium of a seed with a late enhancement image of its prior."""
    try:
        case = write_enhanced(folder, seed, force=force)
    except InputError as error:
        raise click.ClickException(str(error)) from None
    click.echo(f"{folder}: {case.notes}")


@main.command("study")
@FOLDER
@SEED
@click.option("--points", type=click.IntRange(min=50), default=400, show_default=True, help="mapping points")
@click.option("--carto", is_flag=True, help="an export of CARTO 3 with tags, and a late enhancement image")
def _study(folder: Path, seed: int, points: int, carto: bool) -> None:
    """A study of docs/tutorial.md: an OpenEP map without landmarks and a label volume of 5 mm slices; or that
    of docs/tutorial_carto.md.
    """
    if folder.exists():
        raise click.ClickException(f"{folder}: is there already; name another folder")
    if carto:
        write_carto_study(folder, seed, points)
    else:
        write_study(folder, study(atrium(seed, points=points), seed))
    click.echo(f"{folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}")


def _write(folder: Path, made: Callable[[], Case], force: bool) -> None:
    try:
        case = made()
        write_case(folder, case, force=force)
    except InputError as error:
        raise click.ClickException(str(error)) from None
    click.echo(f"{folder}: {case.notes}")


if __name__ == "__main__":
    main(prog_name="python -m data_synth")
