"""Commands that compute numbers of finished runs: measure, segments, change, activation, next."""

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
@click.option("--against", metavar="FIELD", help="of the wall, that values go with; default: image_ratio")
@click.option("--lesions", type=FILE, help="table of lesions in the map's frame, for their distances")
@click.option("--scar-from", default=1.2, show_default=True, help="value of FIELD where scar begins")
@click.option(
    "--by", type=click.Choice(["regions", "segments"]), default="regions", show_default=True, help="of areas"
)
@click.option("--out", type=FILE, help="table of comma-separated values to write, a row for each number")
@as_json
def measure(run_folder: Path, out: Path | None, as_json: bool, **options: Any) -> None:
    """Measure the last surface of a run, each number with its 95 % interval: volume, areas by part and
    below thresholds, sections of veins, distances of named places and of lesions, and how the values go with
    what the image shows of the wall.
    """
    from ..report.mapping import measures

    subject, found = measures.measure_run(run_folder, measures.Asked(**options))
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


@click.command()
@click.argument("before", metavar="A", type=FOLDER)
@click.argument("after", metavar="B", type=FOLDER)
@click.option("--column", default="bipolar", show_default=True, help="value of the points that is compared")
@click.option(
    "--samples", type=click.IntRange(min=20), default=200, show_default=True, help="of each surface"
)
@click.option("--seed", default=0, show_default=True, help="where the random numbers begin")
@click.option("--out", type=FOLDER, help="folder to make: the table, and the surface with what changed")
@as_json
def change(before: Path, after: Path, out: Path | None, as_json: bool, **options: object) -> None:
    """Compare two runs of one heart, as before and after an ablation: which values and what of the shape
    changed beyond the errors of both maps.
    """
    from ..io.atomic import check_free
    from ..report.mapping import change as changes
    from ..report.mapping import change_files

    if out:
        check_free(out, force=False)
    found = changes.change_of((before, after), **options)  # type: ignore[arg-type]
    if out:
        change_files.write_change(out, found)
    say_lines((change_files.as_json if as_json else change_files.as_text)(found))


@click.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option(
    "--cycle",
    type=float,
    metavar="MS",
    help="cycle length, where the wave goes round and round; default: it starts",
)
@click.option("--samples", type=click.IntRange(min=20), default=200, show_default=True, help="of the surface")
@click.option("--seed", default=0, show_default=True, help="where the random numbers begin")
@click.option("--out", type=FOLDER, help="folder to make: the table, and the surface with its times")
@as_json
def activation(run_folder: Path, out: Path | None, as_json: bool, **options: object) -> None:
    """Map the activation of the last surface of a run by the times of its points (column lat): when the wave
    comes by, how fast and which way it goes, each with its 95 % interval.
    """
    from ..io.atomic import check_free
    from ..report.mapping import activation as mapping
    from ..report.mapping import activation_files

    if out:
        check_free(out, force=False)
    found = mapping.activation_of(run_folder, **options)  # type: ignore[arg-type]
    if out:
        activation_files.write_activation(out, found)
    say_lines((activation_files.as_json if as_json else activation_files.as_text)(found))


@click.command("next")
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option(
    "--k", type=click.IntRange(min=1), default=5, show_default=True, help="how many places, at most"
)
@click.option(
    "--reachable",
    type=FILE,
    help="table with a column 'reachable', 1 or 0 for each vertex of the last surface in its order",
)
@click.option("--json", "as_json", is_flag=True, help="print JSON in place of the table")
def next_(run_folder: Path, k: int, reachable: Path | None, as_json: bool) -> None:
    """Name the places where one more mapping point would reduce the uncertainty of the last surface most."""
    from ..report.mapping.table import next_places

    say_lines(next_places(run_folder, k, reachable, as_json=as_json))
