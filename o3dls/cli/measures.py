"""The command that measures a finished run."""

from __future__ import annotations

from pathlib import Path

import click

from .options import as_json
from .words import FILE, FOLDER, say, say_lines


@click.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option(
    "--below",
    type=float,
    multiple=True,
    help="threshold of the column, again for each; default: 0.5 and 1.5 mV of bipolar",
)
@click.option("--column", default="bipolar", show_default=True, help="value of the points that is compared")
@click.option(
    "--samples",
    type=click.IntRange(min=20),  # fewer have no 95 %
    default=200,
    show_default=True,
    help="samples of the surface that intervals are taken from",
)
@click.option("--seed", default=0, show_default=True, help="where the random numbers begin")
@click.option("--out", type=FILE, help="table of comma-separated values to write, a row for each number")
@as_json
def measure(run_folder: Path, out: Path | None, as_json: bool, **options: object) -> None:
    """Measure the last surface of a run, each number with its 95 % interval: volume, areas by region and
    below thresholds, sections of veins, distances of named places.
    """
    from ..report.mapping import measures
    from ..runs.folder import check_not_of_a_run

    if out:
        check_not_of_a_run(out)
    subject, found = measures.measure_run(run_folder, **options)  # type: ignore[arg-type]
    if out:
        measures.write_csv(out, found)
        say(f"{out}: {len(found)} numbers", error=True)
    say_lines((measures.as_json if as_json else measures.as_text)(subject, found))
