"""A run as a page asks for it: a preset or a pipeline file, done in a worker, with the steps told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .bring import command
from .worker import Message, Tell

if TYPE_CHECKING:
    from ..case import Case
    from ..pipeline.pipeline import Pipeline


@dataclass(frozen=True)
class Preset:
    """A preset is the default pipeline with settings, as `o3dls run --set` takes them, or a pipeline file in
    the case folder.
    """

    title: str
    words: str
    settings: tuple[str, ...] = ()
    file: str = ""


OWN, ICP_ONLY = "own", "icp"
PRESETS: Mapping[str, Preset] = {
    "default": Preset(
        "Default",
        "The whole method with cross-validation, which says how well unseen points are met. Minutes.",
    ),
    "quick": Preset(
        "Quick",
        "The same surface without cross-validation: nothing tells how well unseen points are met.",
        ("folds=0",),
    ),
    ICP_ONLY: Preset(
        "ICP only",
        "The prior is moved and scaled as a whole, and keeps its shape: what other programs do.",
        file="icp_only.toml",
    ),
    OWN: Preset(
        "Own pipeline", "The file pipeline.toml in the case folder, as it is now.", file="pipeline.toml"
    ),
}
WRITES = (
    "A run folder holds the surface after each step (PLY, VTP), its scores (scores.csv, run.json), and "
    "report.html. The files of the case stay as they are."
)


def run_name(case: Path, preset: str) -> str:
    """Return the name of the folder of a run, to which a number is added where it is taken."""
    return case.name if preset == "default" else f"{case.name}-{preset}"


def run_command(case: Path, out: Path, preset: str) -> str:
    """Return the line of a shell that makes the same run."""
    if file := PRESETS[preset].file:
        return command("run", [case / file], {"out": out})
    settings = [part for one in PRESETS[preset].settings for part in ("--set", one)]
    return command("run", settings, {"case": case, "out": out})


def run_case(case: Path, out: Path, preset: str, tell: Tell) -> Message:
    """Run a preset on a case, as `o3dls run` does, into the folder `out`; what became of it."""
    from ..io.case_reader import read_case
    from ..pipeline.batch import run_into
    from ..pipeline.file import default_pipeline, read_pipeline
    from ..pipeline.workers import second_process

    chosen = PRESETS[preset]
    if preset == ICP_ONLY:
        _write_icp_only(case / chosen.file, read_case(case))
    plan = read_pipeline(case / chosen.file) if chosen.file else default_pipeline(chosen.settings)
    with second_process(plan.folds) as pool:
        subject = read_case(case)
        plan = plan if chosen.file else plan.allowed_by(subject)
        tell({"steps": plan.steps})
        run = run_into(plan, subject, out, pool=pool)
    return {"faults": list(run.faults)}


def _write_icp_only(path: Path, case: Case) -> None:
    """Write the pipeline file of ICP alone, after what gives the pose of the case."""
    from ..io.atomic import write_file
    from ..io.manifest import noted
    from ..pipeline.file import default_pipeline

    plan: Pipeline = default_pipeline().allowed_by(case)
    names = [stage.name for stage in plan.stages]
    tables = [("stage", name) for name in names[: names.index("icp") + 1]] + [("write", "report")]
    blocks = "".join(f"\n[[{kind}]]\n" + f'use = "{name}"\n' for kind, name in tables)
    with noted(path.parent):
        head = "# ICP alone: the prior keeps its shape. The app writes this file anew for each such run.\n"
        write_file(path, f'{head}case = "."\n{blocks}', within=path.parent)
