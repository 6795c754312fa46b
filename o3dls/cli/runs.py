"""Commands that make runs, and what they are made of: demo, run, init, check, stages, schema, paper; and
slices, which draws a run on the image that it began with.
"""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from . import completion
from .options import as_json, ask_files, ask_whose, overrides, prior_choice, progress
from .words import DONE, FILE, FOLDER, NOT_VALID, WRONG_INPUT, complain, say, say_json, say_lines

if TYPE_CHECKING:
    from ..runs.run import Run


@click.command()
@click.option(
    "--out",
    type=FOLDER,
    default=Path("o3dls_demo"),
    show_default=True,
    help="run folder; an earlier demo is replaced",
)
@click.option("--force", is_flag=True, help="replace any other run in the same folder too")
@as_json
@progress
def demo(out: Path, force: bool, as_json: bool) -> int:
    """Run the main job on the built-in atrium: align, deform, refine, score, report, export."""
    from ..io.case_reader import read_case
    from ..pipeline.batch import run_into
    from ..pipeline.file import default_pipeline
    from ..pipeline.workers import second_process
    from ..resources import demo_case
    from ..runs.folder import repeats
    from .environment import check_libraries
    from .progress import run_bar

    check_libraries()
    plan = default_pipeline()
    with second_process(plan.folds) as pool:
        case = read_case(demo_case())
        force = force or ((out / "run.json").is_file() and repeats(out, plan.record(), case))
        with run_bar(plan):
            done = run_into(plan, case, out, force=force, pool=pool)
    return _report_run(done, out, as_json=as_json)


@click.command()
@click.argument("pipeline", type=FILE, required=False)
@click.option("--case", type=FOLDER, help="case folder; overrides the pipeline's")
@click.option("--points", type=FILE, help="points file in place of the case's")
@click.option("--units", help="units of the case where its files do not say: mm, cm, m, um, in, px")
@click.option("--frame", help="frame of the points: LPS, RAS or unknown")
@click.option("--out", type=FOLDER, help="run folder to make; default: the pipeline's, else runs/CASE")
@overrides
@click.option("--force", is_flag=True, help="replace an earlier run in the same folder")
@as_json
@progress
def run(
    pipeline: Path | None,
    case: Path | None,
    out: Path | None,
    settings: tuple[str, ...],
    force: bool,
    as_json: bool,
    **reading: Any,
) -> int:
    """Run a PIPELINE file, or without one the default pipeline with what the case allows."""
    from ..errors import InputError
    from ..io.atomic import check_free
    from ..io.case_reader import read_case
    from ..pipeline.batch import run_into
    from ..pipeline.file import default_pipeline, read_pipeline
    from ..pipeline.workers import second_process
    from .environment import check_libraries
    from .progress import run_bar

    check_libraries()
    if pipeline and pipeline.is_dir():
        raise InputError(
            f"{pipeline}: is a folder, not a pipeline file; if it is a case, say --case "
            f"{shlex.quote(str(pipeline))}"
        )
    plan = read_pipeline(pipeline, settings) if pipeline else default_pipeline(settings)
    folder = _require_value(case or plan.case, "--case")
    out = out or plan.out or Path("runs") / folder.resolve().name
    with second_process(plan.folds) as pool:
        subject = read_case(folder, **reading)
        check_free(out, force, "run", [one for one in (folder, reading["points"], pipeline) if one])
        plan = plan if pipeline else plan.allowed_by(subject)
        with run_bar(plan):
            done = run_into(plan, subject, out, force=force, pool=pool)
    return _report_run(done, out, as_json=as_json)


@click.command()
@click.argument("folder", metavar="DIR", type=FOLDER)
@click.option("--prior", type=FILE, help="surface or label volume that is the prior")
@click.option("--points", type=FILE, help="mapping points: a table with x, y, z and type, or a cloud")
@click.option(
    "--landmarks", type=FILE, help="places named on the prior: .mrk.json, .fcsv, JSON, or a table name,x,y,z"
)
@click.option("--units", help="units of files that do not state theirs: mm, cm, m, um, in, px")
@click.option("--columns", help="which columns of the points these are: bipolar=V1,x=East")
@click.option("--frame", help="frame of points and label volumes that state none: LPS, RAS or unknown")
@prior_choice
@click.option("--out", type=FOLDER, help="run folder that the pipeline names; default: run in DIR")
@click.option("--force", is_flag=True, help="replace the folder if it is a case")
def init(folder: Path, prior: Path | None, points: Path | None, **options: Any) -> None:
    """Make a case folder of a prior and a points file, with a commented pipeline.toml to run and to change.

    Asks for the files that are not given.
    """
    from ..pipeline.new_case import Inputs, make_case

    if prior is None or points is None:
        prior, points, options["landmarks"] = ask_files(prior, points, options["landmarks"])
        options["prior_of"] = options["prior_of"] or ask_whose()
    inputs = Inputs(prior, points, options.pop("landmarks"), options.pop("image"))
    pipeline = make_case(folder, inputs, **options)
    say(pipeline)
    say(f"to run it: o3dls run {shlex.quote(str(pipeline))}", error=True)


@click.command()
@click.argument("pipeline", type=FILE)
@click.option("--case", type=FOLDER, help="case folder; overrides the pipeline's")
@as_json
def check(pipeline: Path, case: Path | None, as_json: bool) -> int:
    """Name every mistake of a PIPELINE file and its case before any work."""
    from ..pipeline.file import all_mistakes

    mistakes = all_mistakes(pipeline, case)
    if as_json:
        say_json({"pipeline": str(pipeline), "mistakes": mistakes})
        return WRONG_INPUT if mistakes else DONE
    for mistake in mistakes:
        complain(mistake)
    if not mistakes:
        say(f"{pipeline}: no mistakes")
    return WRONG_INPUT if mistakes else DONE


@click.command()
@click.argument("name", required=False, shell_complete=completion.stages)
@click.option("--markdown", is_flag=True, help="the parameters, of all without NAME, as tables for documents")
def stages(name: str | None, markdown: bool) -> None:
    """List stages and writers, or the parameters of NAME with unit, default and bounds."""
    from ..plugins.catalogue import listing, sheet, table, tables

    if markdown:
        say_lines(table(name) if name else tables())
    else:
        say_lines(sheet(name) if name else listing())


@click.command()
def schema() -> None:
    """Print the JSON schema of a pipeline file, by which an editor completes and checks it."""
    from ..pipeline import schema as pipeline_schema

    say_json(pipeline_schema.schema())


@click.command()
@click.option(
    "--out",
    type=FOLDER,
    required=True,
    help="folder to make: index.html, index.md, figures, and the numbers behind them",
)
@click.option("--quick", is_flag=True, help="few seeds and levels: about one minute instead of six")
@click.option("--force", is_flag=True, help="replace an earlier page in the same folder")
def paper(out: Path, quick: bool, force: bool) -> None:
    """Compute the paper's experiments and the questions it left open, with fixed seeds, and write one page
    about them.
    """
    from ..paper.compute import make

    say(make(out, quick=quick, force=force))


@click.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option("--out", type=FOLDER, help="folder for the pictures; default: slices in the run folder")
@click.option("--image", type=FILE, help="image of the prior, where the run has none or it stands elsewhere")
def slices(run_folder: Path, out: Path | None, image: Path | None) -> None:
    """Draw slices of the prior's image with the contours of prior, ICP and result, as PNG files."""
    from ..report.stacks.pictures import write_slices

    say(write_slices(run_folder, out, image))


@click.command()
@click.argument("run_folder", metavar="RUN", type=FOLDER)
@click.option(
    "--layer",
    type=float,
    nargs=2,
    default=(0.5, 2.0),
    show_default=True,
    help="distances from the surface in mm, outward positive",
)
@click.option(
    "--take",
    type=click.Choice(["mean", "max"]),
    default="mean",
    show_default=True,
    help="mean or largest value of the layer",
)
@click.option("--out", type=FOLDER, help="folder for the files; default: wall in the run folder")
@click.option("--image", type=FILE, help="image of the prior, where the run has none or it stands elsewhere")
def wall(run_folder: Path, layer: tuple[float, float], take: Any, **options: Any) -> None:
    """Sample the prior's image on the wall: values, and ratios to the blood, on prior, result and points."""
    from ..evaluation.wall_image import Layer
    from ..runs.image.values import write_image_values

    target, found = write_image_values(run_folder, Layer(*layer, take), **options)
    say(f"blood {found.blood.mean:.4g}, sd {found.blood.sd:.3g}, {found.blood.places} places")
    say(target)


def _require_value(value: Path | None, option: str) -> Path:
    if value is None:
        raise click.UsageError(f"no {option} given, and the pipeline names none")
    return value


def _report_run(result: Run, out: Path, *, as_json: bool) -> int:
    """Print the scores of a finished run, whether to trust it and where it is; say what is not valid."""
    from ..runs.record import plain
    from .summary import summary

    found = summary(out, result)
    if as_json:
        said = {"valid": not result.faults, "faults": result.faults, "scores": plain(result.scores)}
        say_json(found.record | said)
    else:
        say_lines(result)
        found.say()
    for fault in result.faults:
        complain(f"the result is not valid: {result.final}: {fault}")
    return NOT_VALID if result.faults else DONE
