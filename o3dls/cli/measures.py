"""Commands that measure what is on a surface: measure, segments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .options import as_json
from .words import FILE, FOLDER, complain, say_lines


@click.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option("--below", type=float, multiple=True, help="threshold, once for each; default: 0.5 and 1.5 mV")
@click.option("--column", default="bipolar", show_default=True, help="value of the points that is compared")
@click.option("--samples", type=click.IntRange(min=20), default=200, show_default=True, help="of the surface")
@click.option("--seed", default=0, show_default=True, help="where the random numbers begin")
@click.option("--out", type=FILE, help="table of comma-separated values to write, a row for each number")
@as_json
def measure(run_folder: Path, out: Path | None, as_json: bool, **options: object) -> None:
    """Measure the last surface of a run, each number with its 95 % interval: volume, areas by region and
    below thresholds, sections of veins, distances of named places.
    """
    from ..report.mapping import measures

    subject, found = measures.measure_run(run_folder, **options)  # type: ignore[arg-type]
    if out:
        measures.write_csv(out, found)
    say_lines((measures.as_json if as_json else measures.as_text)(subject, found))


@click.command()
@click.argument("source", metavar="RUN_OR_MESH", type=click.Path(path_type=Path, exists=True))
@click.option("--out", type=FILE, help="surface to write, with its segments as fields: .vtp, .vtk, .ply")
@click.option("--landmarks", type=FILE, help="mesh: named veins, appendage, valve; default: they are found")
@click.option("--frame", type=click.Choice(["LPS", "RAS"]), help="mesh: frame, where its file states none")
@click.option(
    "--samples", type=click.IntRange(min=1), default=50, show_default=True, help="run: of its surface"
)
@click.option("--seed", default=0, show_default=True, help="where the random numbers begin")
@as_json
def segments(source: Path, out: Path | None, as_json: bool, **options: Any) -> None:
    """Divide a left atrium into the segments of the EHRA/EACVI consensus, and print their areas: the last
    surface of a run, or a mesh in mm.
    """
    from ..report.mapping import segments as mapping

    found = mapping.divide_source(source, **options)
    lost = mapping.write_divided(out, found) if out else []
    say_lines((mapping.as_json if as_json else mapping.as_text)(found))
    for sentence in lost:
        complain(sentence)
