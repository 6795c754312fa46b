"""A paragraph of methods to copy into a paper, and what to cite."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ...runs.record import Provenance
from ..markup import join, tag
from ..section import Section
from ..shape_words import words_of
from ..subject import Subject
from .provenance import copied

Record = Mapping[str, Any]
# as in CITATION.cff, which programs read; a test compares them
AUTHORS = "The o3dls developers"
TITLE = "o3dls: registration and reconstruction of an atrium from a prior surface and sparse points"
RELEASED = "2026-11-25"
PLACING = ("use", "as", "after")
OPEN3D = """@article{open3d,
  author = {Zhou, Qian-Yi and Park, Jaesik and Koltun, Vladlen},
  title = {{Open3D}: A Modern Library for {3D} Data Processing},
  journal = {arXiv:1801.09847},
  year = {2018}
}"""


def methods_section(subject: Subject) -> Section:
    """Describe what the run of the last estimate did, with parameters, versions and citation."""
    made = subject.last.run.provenance
    return Section(
        "methods",
        "Methods to copy",
        join(
            copied(paragraph(subject, made), "methods-text"),
            tag("p", "To cite:"),
            copied(bibtex(made.versions["o3dls"]), "methods-bibtex"),
        ),
    )


def paragraph(subject: Subject, made: Provenance) -> str:
    """Describe the method in full sentences; every number is that of run.json."""
    case, versions, pipeline = subject.case, made.versions, made.pipeline
    counts = ", ".join(f"{n} of type {kind}" for kind, n in made.case.points.items())
    done = " ".join(
        f"({number}) {_describe_stage(stage, subject.unit)}."
        for number, stage in enumerate(pipeline["stage"], 1)
    )
    words, folds = words_of(subject), pipeline["folds"]
    left_out = (
        f" Every stage was cross-validated in {folds} folds of spatial blocks of points." if folds else ""
    )
    software = ", ".join(f"{name} {number}" for name, number in versions.items() if number)
    return (
        f"A prior {words.shape} of {len(case.prior.faces)} {words.pieces} was registered to points "
        f"({counts}) and fused with them by o3dls {versions['o3dls']} [o3dls], which builds on Open3D "
        f"[open3d]: {done} Errors are exact distances from points to the {words.shape}, in {subject.unit}; "
        f"differences have 95 % intervals from a bootstrap of spatial blocks.{left_out} Software: {software}."
    )


def bibtex(version: str | None) -> str:
    """Write the entries for o3dls, in the `version` that made the run, and for Open3D."""
    own = f"""@software{{o3dls,
  author = {{{{{AUTHORS}}}}},
  title = {{{TITLE}}},
  version = {{{version}}},
  year = {{{RELEASED[:4]}}}
}}"""
    return f"{own}\n\n{OPEN3D}"


def _describe_stage(stage: Record, unit: str) -> str:
    """Say what a stage did, in words where it is one of ours, and its parameters."""
    known_words = SAID.get(stage["use"])
    said = known_words(stage, unit) if known_words else f"stage {stage['use']}"
    known = [
        f"{key} = {_write_value(value)}"
        for key, value in stage.items()
        if key not in PLACING and value not in (None, [], {})
    ]
    began = f", from {stage['after']}" if stage.get("after") else ""
    return f"{said}{began} ({', '.join(known)})" if known else f"{said}{began}"


def _describe_motion(stage: Record) -> str:
    """Name the kind of pose, as far as the record tells: a stage of another package may have one of our
    names.
    """
    scale = stage.get("scale")
    return "a pose" if scale is None else "a similarity" if scale else "a rigid motion"


def _describe_grid(stage: Record, unit: str) -> str:
    spacing = stage.get("spacing")
    return "a level set" if spacing is None else f"a level set on a {spacing:g} {unit} grid"


SAID: Mapping[str, Callable[[Record, str], str]] = {
    "landmarks": lambda stage, _: f"{_describe_motion(stage)} from named landmarks",
    "icp": lambda stage, _: f"{_describe_motion(stage)} by iterative closest points",
    "global_pose": lambda *_: "a search for the pose without a start",
    "deform": lambda *_: "a smooth deformation of the prior with its posterior",
    "topology": lambda *_: "a test of whether the points support another topology",
    "level_set": _describe_grid,
}


def _write_value(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_write_value, value)) + "]"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_write_value(one)}" for key, one in value.items())
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
