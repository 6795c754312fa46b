"""A run as a page asks for it: a preset or a pipeline file, done in a worker, with the steps told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from .bring import command
from .worker import Message, Tell


@dataclass(frozen=True)
class Preset:
    """A preset is the default pipeline with settings, as `o3dls run --set` takes them."""

    title: str
    words: str
    settings: tuple[str, ...] = ()


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
}
OWN = "own"  # in place of a preset: the pipeline file of the case


def run_command(case: Path, out: Path, preset: str) -> str:
    """Return the line of a shell that makes the same run."""
    if preset == OWN:
        return command("run", [case / "pipeline.toml"], {"out": out})
    settings = [part for one in PRESETS[preset].settings for part in ("--set", one)]
    return command("run", settings, {"case": case, "out": out})


def run_case(case: Path, out: Path, preset: str, tell: Tell) -> Message:
    """Run a preset, or the pipeline file of the case, on a case, as `o3dls run` does, into the folder `out`;
    what became of it.
    """
    from ..io.case_reader import read_case
    from ..pipeline.batch import run_into
    from ..pipeline.file import default_pipeline, read_pipeline
    from ..pipeline.workers import second_process

    own = preset == OWN
    plan = read_pipeline(case / "pipeline.toml") if own else default_pipeline(PRESETS[preset].settings)
    with second_process(plan.folds) as pool:
        subject = read_case(case)
        plan = plan if own else plan.allowed_by(subject)
        tell({"steps": plan.steps})
        run = run_into(plan, subject, out, pool=pool)
    return {"faults": list(run.faults)}
