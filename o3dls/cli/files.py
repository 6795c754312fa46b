"""Commands on finished runs and files: report, compare, export, carry, convert, send, import, view."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .options import complete_estimate, complete_format, prior_choice
from .words import FILE, FOLDER, complain, say, say_lines


@click.command()
@click.argument("runs", metavar="RUN...", type=FOLDER, nargs=-1, required=True)
@click.option("--out", type=FILE, help="HTML file to write; default: report.html in the first run folder")
@click.option(
    "--compare",
    multiple=True,
    metavar="ESTIMATE",
    shell_complete=complete_estimate,
    help="estimate to show; may be repeated; default: the ICP and the last",
)
@click.option("--pdf", is_flag=True, help="also a one-page PDF for slides, and its pictures in figures/")
@click.option("--activation", is_flag=True, help="also activation times and speeds; takes some seconds")
def report(
    runs: tuple[Path, ...], out: Path | None, compare: tuple[str, ...], pdf: bool, activation: bool
) -> None:
    """Write the report on a finished run, or on several runs of one case."""
    from ..report.writer import write_report

    say(write_report(runs, out, compare=compare, pdf=pdf, activation=activation))


@click.command()
@click.argument("runs", metavar="RUN...", type=FOLDER, nargs=-1, required=True)
@click.option("--out", type=FILE, default=Path("compare.html"), show_default=True, help="HTML page to write")
def compare(runs: tuple[Path, ...], out: Path) -> None:
    """Compare finished runs of one case or many: scores in one table, and a page with the worst first and
    links to the reports.
    """
    from ..report.writer import compare as write_comparison
    from ..runs.comparison import comparison
    from ..runs.folder import read_run

    say_lines(comparison({str(folder): read_run(folder) for folder in runs}))
    say(write_comparison(runs, out))


@click.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option(
    "--format",
    default="ply",
    show_default=True,
    shell_complete=complete_format,
    help="file format, such as ply, vtp, carto_vtk, mask_nrrd, tfm, itk, mrb",
)
@click.option("--estimate", shell_complete=complete_estimate, help="estimate to write; default: the last")
@click.option("--out", type=FILE, help="file to write; default: in the run's folder export/")
@click.option(
    "--on",
    type=click.Choice(["map", "prior"]),
    default="map",
    show_default=True,
    help="on the map, or on the prior's own surface in its own frame: the patient's image",
)
@click.option(
    "--spacing", type=float, help="phi, mask, itk, mrb: size of a voxel, distance of nodes; default: 1 mm"
)
@click.option("--grid", type=FILE, help="mask: image whose voxels it takes, such as the prior's")
@click.option("--image", type=FILE, help="mrb: grey image of the prior; default: the case's, if it names one")
@click.option("--frame", help="frame to write in, LPS or RAS; default: that of the map or the prior")
@click.option("--field", help="carto_vtk: the field that becomes its one scalar")
@click.option("--vmin", type=float, help="carto_vtk: value at the lower end of the colours")
@click.option("--vmax", type=float, help="carto_vtk: value at the upper end of the colours")
def export(run_folder: Path, out: Path | None, spacing: float | None, **options: Any) -> None:
    """Write a surface or the motion of a finished run for other programs, with a sidecar that says frame,
    units and what the values mean.
    """
    from ..runs.export.finished import export_run

    options |= {} if spacing is None else {"spacing": spacing}
    say(export_run(run_folder, out, **options))


@click.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.argument("source", metavar="FILE", type=FILE)
@click.option(
    "--to",
    type=click.Choice(["map", "image"]),
    required=True,
    help="where to: from the prior's image to the map, or back",
)
@click.option("--out", type=FILE, help="file to write; default: in the run's folder export/")
@click.option("--estimate", shell_complete=complete_estimate, help="whose motion; default: the last")
@click.option("--units", help="units of FILE where it does not state them: mm, cm, m, um, in")
@click.option("--frame", help="frame of FILE where it does not state it: LPS or RAS")
def carry(run_folder: Path, source: Path, **options: Any) -> None:
    """Carry a surface, points, lines, a label volume or named places through the motion of a run, with the
    deviation at each place.
    """
    from ..runs.export.carry import carry as carry_file

    say(carry_file(run_folder, source, **options))


@click.command()
@click.argument("source", metavar="IN", type=FILE)
@click.argument("target", metavar="OUT", type=FILE)
@click.option("--format", help="format of OUT where its suffix stands for several, such as carto_vtk")
@click.option("--units", help="units of IN where it does not state them: mm, cm, m, um, in")
@click.option("--frame", help="frame of IN where it does not state it: LPS or RAS")
@click.option("--to", help="frame to write, LPS or RAS")
@click.option("--cap", is_flag=True, help="close the openings of a surface")
@click.option("--repair", is_flag=True, help="repair a surface: weld it, drop what is twice, loose or inside")
@click.option("--faces", type=int, help="decimate to so many triangles")
@click.option("--label", type=int, help="label volumes: the label to take")
@click.option("--part", help="the named segment or volume to take")
@click.option("--box", type=float, nargs=6, help="label volumes: cut to least x y z, most x y z (mm, LPS)")
@click.option("--layer", "--phase", "layer", type=int, help="4D volumes: the layer or phase, from 0")
@click.option("--fill-slices", is_flag=True, help="label volumes: interpolate blank slices")
@click.option("--columns", help="tables of points: which columns these are: bipolar=V1,x=East")
@click.option(
    "--form",
    type=click.Choice(["sform", "qform"]),
    help="NIfTI of two forms that contradict: the right one",
)
@click.option(
    "--sidecar",
    type=click.Choice(["ignore", "take"]),
    help="volume that a JSON file beside it contradicts: what is done with that",
)
def convert(source: Path, target: Path, **options: Any) -> None:
    """Write a surface, points, named places or a pose in another format; frame and units are said on both
    sides.
    """
    from ..runs.conversion import convert as convert_file

    for sentence in convert_file(source, target, **options):
        say(sentence)


@click.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option("--estimate", shell_complete=complete_estimate, help="estimate to send; default: the last")
@click.option(
    "--on",
    type=click.Choice(["map", "prior"]),
    default="map",
    show_default=True,
    help="on the map, or on the prior's own surface in its own frame",
)
@click.option("--host", default="localhost", show_default=True, help="where the receiver listens")
@click.option("--port", default=18944, show_default=True, help="its port; this is Slicer's")
def send(run_folder: Path, **options: Any) -> None:
    """Send a finished run live by OpenIGTLink: surface, landmarks, ablation points and pose, in RAS."""
    from ..runs.live import send as send_run

    count, closed = send_run(run_folder, **options)
    say(f"{count} bytes sent")
    if not closed:
        complain("the receiver did not close the connection, so it may not have read all of them")


@click.command("import")
@click.argument("study", type=FILE)
@click.argument("out", metavar="DIR", type=FOLDER)
@click.option("--map", "map_name", help="name of the map; default: the only one with points")
@click.option("--prior", type=FILE, help="surface or label volume that becomes the prior")
@click.option(
    "--landmarks", type=FILE, help="places named on the prior: .mrk.json, .fcsv, JSON, or a table name,x,y,z"
)
@prior_choice
@click.option("--units", help="units of the prior where it does not state them: mm, cm, m, um, in")
@click.option("--frame", help="frame of the prior where it does not state it: LPS or RAS")
@click.option("--force", is_flag=True, help="replace the folder if it is a case")
def import_(study: Path, out: Path, map_name: str | None, **options: Any) -> None:
    """Make a case folder of a CARTO 3, EnSite or OpenEP study (folder, zip or file), and say what was taken
    and what was left.
    """
    from ..columns import column_table
    from ..io.mapping.study_import import import_study

    found = import_study(study, map_name, out, **options)
    lines = [*(f"took {line}" for line in found.took), *(f"left {line}" for line in found.left)]
    for line in (*lines, *found.notes, *column_table(found.columns), out):
        say(line)


@click.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option("--window", is_flag=True, help="a window of Open3D instead, switched by keys: H lists them")
def view(run_folder: Path, window: bool) -> None:
    """Look at a finished run: its report in the browser, beginning with the pictures."""
    if window:
        _open_window(run_folder)
        return
    from ..report.browser import page_of, show

    page = page_of(run_folder)
    say(page)
    show(page)


def _open_window(run_folder: Path) -> None:
    import signal

    from ..report.window import open_window

    # Open3D's loop does not return to Python, where the command line would hear of it
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    open_window(run_folder)
