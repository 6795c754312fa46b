"""The command line: arguments in, one result on stdout, progress and one line of error on stderr, an exit code that means something."""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path
from typing import Any

import click

from . import __version__
from .errors import O3dlsError, SolverError

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: our systems are small, and threads made them ten times slower

DONE, NOT_VALID, WRONG_INPUT, INTERNAL = 0, 1, 2, 3
FOLDER = click.Path(path_type=Path)
FILE = click.Path(path_type=Path)


class Lines(logging.Formatter):
    """Progress as plain lines; what is wrong says so first."""

    def format(self, record: logging.LogRecord) -> str:
        return record.getMessage() if record.levelno <= logging.INFO else f"{record.levelname.lower()}: {record.getMessage()}"


def main() -> None:
    """Run a command and end the process with its exit code."""
    handler = logging.StreamHandler()
    handler.setFormatter(Lines())
    logging.basicConfig(handlers=[handler], level=logging.WARNING)
    logging.getLogger("o3dls").setLevel(logging.INFO)
    sys.exit(answer(sys.argv[1:]))


def answer(arguments: list[str]) -> int:
    """The exit code of a command; errors become one line on stderr, only what is our own mistake shows a traceback."""
    try:
        return cli.main(arguments, prog_name="o3dls", standalone_mode=False) or DONE
    except click.ClickException as error:
        return _failed(error.format_message(), WRONG_INPUT)
    except click.exceptions.Abort:
        return _failed("interrupted", INTERNAL)
    except SolverError as error:
        return _failed(str(error), INTERNAL)
    except (O3dlsError, OSError) as error:
        return _failed(str(error), WRONG_INPUT)
    except Exception as error:
        import traceback

        traceback.print_exc()
        return _failed(f"internal error, please report it: {type(error).__name__}: {error}", INTERNAL)


def _failed(sentence: str, code: int) -> int:
    click.echo(f"o3dls: {' '.join(sentence.split())}", err=True)
    return code


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.version_option(__version__, prog_name="o3dls")
def cli() -> None:
    """Fuse an atrium's prior surface with electroanatomic points. Research software, not for clinical use."""


@cli.command()
@click.option("--out", type=FOLDER, default=Path("o3dls_demo"), show_default=True, help="run folder; an earlier demo is replaced")
def demo(out: Path) -> int:
    """Run the main job on the built-in atrium: align, deform, refine, score, report, export."""
    from .batch import run_into
    from .io.case_folder import read_case
    from .pipeline_file import default_pipeline
    from .resources import demo_case

    return _told(run_into(default_pipeline(), read_case(demo_case()), out, force=True), out)


@cli.command()
@click.argument("pipeline", type=FILE, required=False)
@click.option("--case", type=FOLDER, help="case folder; overrules the pipeline's")
@click.option("--points", type=FILE, help="points file in place of the case's")
@click.option("--units", help="units of the case where its files do not say: mm, cm, m, um, px")
@click.option("--frame", help="frame of the points: LPS, RAS or unknown")
@click.option("--out", type=FOLDER, help="run folder to make; overrules the pipeline's")
@click.option("--set", "settings", multiple=True, metavar="STAGE.PARAM=VALUE", help="overrule a parameter of the pipeline; may be repeated")
@click.option("--force", is_flag=True, help="replace an earlier run in the same folder")
def run(pipeline: Path | None, case: Path | None, out: Path | None, settings: tuple[str, ...], force: bool, **reading: Any) -> int:
    """Run a PIPELINE file, or without one the default pipeline with what the case allows."""
    from .batch import run_into
    from .io.atomic import check_free
    from .io.case_folder import read_case
    from .pipeline_file import default_pipeline, read_pipeline

    plan = read_pipeline(pipeline, settings) if pipeline else default_pipeline(settings)
    folder = _needed(case or plan.case, "--case")
    out = _needed(out or plan.out, "--out")
    check_free(out, force)
    subject = read_case(folder, **reading)
    return _told(run_into(plan if pipeline else plan.allowed_by(subject), subject, out, force=force), out)


@cli.command()
@click.argument("pipeline", type=FILE)
@click.option("--case", type=FOLDER, help="case folder; overrules the pipeline's")
def check(pipeline: Path, case: Path | None) -> int:
    """Name every mistake of a PIPELINE file and its case before any work."""
    from .pipeline_file import all_mistakes

    mistakes = all_mistakes(pipeline, case)
    for mistake in mistakes:
        click.echo(f"o3dls: {' '.join(mistake.split())}", err=True)
    if not mistakes:
        click.echo(f"{pipeline}: no mistakes")
    return WRONG_INPUT if mistakes else DONE


@cli.command()
@click.argument("name", required=False)
def stages(name: str | None) -> None:
    """List stages and writers, or the parameters of NAME with unit, default and bounds."""
    from .catalogue import listing, sheet

    click.echo(sheet(name) if name else listing())


@cli.command()
@click.argument("cases", type=FOLDER, nargs=-1, required=True)
@click.option("--pipeline", type=FILE, help="pipeline file; without one the default pipeline with what each case allows")
@click.option("--out", type=FOLDER, default=Path("runs"), show_default=True, help="folder for the run folders and cohort.csv")
@click.option("--set", "settings", multiple=True, metavar="STAGE.PARAM=VALUE", help="overrule a parameter of the pipeline; may be repeated")
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="cases that run at one time")
@click.option("--force", is_flag=True, help="replace earlier runs in the same folders")
def batch(cases: tuple[Path, ...], pipeline: Path | None, out: Path, settings: tuple[str, ...], jobs: int, force: bool) -> int:
    """Run one pipeline over many CASES, side by side, and write one table of the cohort."""
    from .batch import run_cohort
    from .pipeline_file import default_pipeline, read_pipeline

    plan = read_pipeline(pipeline, settings) if pipeline else default_pipeline(settings)
    outcomes = run_cohort(cases, plan, out, jobs=jobs, trim=not pipeline, force=force)
    for outcome in outcomes:
        click.echo(f"{outcome.case}: {outcome.error or '; '.join(outcome.faults) or 'done'}")
    click.echo(f"{out / 'cohort.csv'}")
    if any(outcome.error for outcome in outcomes):
        return WRONG_INPUT
    return NOT_VALID if any(outcome.faults for outcome in outcomes) else DONE


@cli.command()
@click.argument("runs", metavar="RUN...", type=FOLDER, nargs=-1, required=True)
@click.option("--out", type=FILE, help="HTML file to write; default: report.html in the first run folder")
@click.option("--compare", multiple=True, metavar="ESTIMATE", help="estimate to show; may be repeated; default: the ICP and the last")
@click.option("--slides/--no-slides", default=True, show_default=True, help="pictures in figures/ and a one-page PDF beside the page")
def report(runs: tuple[Path, ...], out: Path | None, compare: tuple[str, ...], slides: bool) -> None:
    """Write the report on a finished run, or on several runs of one case."""
    from .report import write_report

    click.echo(write_report(runs, out, compare=compare, slides=slides))


@cli.command()
@click.argument("runs", metavar="RUN...", type=FOLDER, nargs=-1, required=True)
@click.option("--out", type=FILE, default=Path("compare.html"), show_default=True, help="HTML page to write")
def compare(runs: tuple[Path, ...], out: Path) -> None:
    """Compare finished runs of one case or many: scores in one table, and a page with the worst first and links to the reports."""
    from .report import compare as write_comparison
    from .run_folder import read_run
    from .tables import comparison

    click.echo(comparison({str(folder): read_run(folder) for folder in runs}))
    click.echo(write_comparison(runs, out))


@cli.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option("--format", default="ply", show_default=True, help="ply, stl, obj, off, vtk, vtp, carto_vtk")
@click.option("--estimate", help="estimate to write; default: the last")
@click.option("--out", type=FILE, help="file to write; default: in the run's folder export/")
@click.option("--frame", help="frame to write in, LPS or RAS; default: the frame of the case")
@click.option("--field", help="carto_vtk: the field that becomes its one scalar")
@click.option("--vmin", type=float, help="carto_vtk: value at the lower end of the colours")
@click.option("--vmax", type=float, help="carto_vtk: value at the upper end of the colours")
def export(run_folder: Path, out: Path | None, **options: Any) -> None:
    """Write a surface of a finished run for other programs, with a sidecar that says frame, units and what the values mean."""
    from .export import export_run

    click.echo(export_run(run_folder, out, **options))


@cli.command()
@click.argument("source", metavar="IN", type=FILE)
@click.argument("target", metavar="OUT", type=FILE)
@click.option("--format", help="format of OUT where its suffix does not tell, such as carto_vtk")
@click.option("--units", help="units of IN where it does not state them: mm, cm, m, um")
@click.option("--frame", help="frame of IN where it does not state it: LPS or RAS")
@click.option("--to", help="frame to write, LPS or RAS")
@click.option("--cap", is_flag=True, help="close the openings of a surface")
@click.option("--faces", type=int, help="decimate to so many triangles")
@click.option("--label", type=int, help="label volumes: the label to take")
@click.option("--part", help="the named segment or volume to take")
@click.option("--box", type=float, nargs=6, help="label volumes: cut to least x y z, most x y z (mm, LPS)")
def convert(source: Path, target: Path, **options: Any) -> None:
    """Write a surface, points, named places or a pose in another format; frame and units are said on both sides."""
    from .convert import convert as convert_file

    for sentence in convert_file(source, target, **options):
        click.echo(sentence)


@cli.command("import")
@click.argument("study", type=FILE)
@click.argument("out", metavar="DIR", type=FOLDER)
@click.option("--map", "map_name", help="name of the map; default: the only one with points")
@click.option("--prior", type=FILE, help="surface or label volume that becomes the prior")
@click.option("--landmarks", type=FILE, help="places named on the prior: .mrk.json, .fcsv, or .csv with name,x,y,z")
@click.option("--cap", is_flag=True, help="close the openings of the prior")
@click.option("--label", type=int, help="label volume: the label to take")
@click.option("--part", help="the named segment or volume of the prior")
@click.option("--box", type=float, nargs=6, help="label volume: cut to least x y z, most x y z (mm, LPS)")
@click.option("--force", is_flag=True, help="replace the folder if it is a case")
def import_(study: Path, out: Path, map_name: str | None, **options: Any) -> None:
    """Make a case folder of a CARTO 3, EnSite or OpenEP study (folder, zip or file), and say what was taken and what was left."""
    from .io.study import import_study

    found = import_study(study, map_name, out, **options)
    click.echo("\n".join([*(f"took {line}" for line in found.took), *(f"left {line}" for line in found.left), str(out)]))


@cli.command()
def doctor() -> int:
    """Check this machine, and say how to mend each fault."""
    from .doctor import diagnose

    checks = diagnose()
    for check in checks:
        click.echo(check)
    return DONE if all(check.ok for check in checks if check.needed) else NOT_VALID


@cli.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
def view(run_folder: Path) -> None:
    """Open a window on a finished run; keys switch estimates, colours, points, prior and truth."""
    from .view import view as open_window

    open_window(run_folder)


def _needed(value: Path | None, option: str) -> Path:
    if value is None:
        raise click.UsageError(f"no {option} given, and the pipeline names none")
    return value


def _told(result: Any, out: Path) -> int:
    """Print the scores of a finished run and where it is; say what is not valid."""
    click.echo(f"{result}\n{out}")
    for fault in result.faults:
        click.echo(f"o3dls: the result is not valid: {result.final}: {fault}", err=True)
    return NOT_VALID if result.faults else DONE
