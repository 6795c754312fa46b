"""A new case folder: case.toml and pipeline.toml, with comments on what each line means and what one may
change.
"""

from __future__ import annotations

import logging
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..columns import column_table
from ..errors import InputError
from ..io.atomic import check_free, staged_folder, write_file
from ..io.case_reader import case_of
from ..io.case_settings import new_folder, toml_lines
from ..io.grey.of_case import with_image
from ..io.images.dicom import check_no_series
from ..io.manifest import write_manifest
from ..parallel import compiling_said
from ..places import seen_from
from ..plugins.catalogue import as_toml, commented, meaning
from ..plugins.plugin import Plugin
from .file import default_pipeline
from .pipeline import Pipeline

log = logging.getLogger("o3dls")
CASE_HEAD = """\
# The case: the files that belong together, and what they do not say themselves.
# A line '# name = value' is a default; to change it, remove the # and write another value.
# Paths are relative to this folder. Every key: docs/folders.md

"""
PIPELINE_HEAD = """\
# The pipeline: the stages that the case goes through, in this order, and the files that they leave behind.
# A line '# name = value' is a default; to change it, remove the # and write another value.
# All parameters of a stage: o3dls stages NAME. After a change: o3dls check FILE

"""
# key, the default that is shown where it is not given, meaning; no default: shown only where given
CASE_KEYS: tuple[tuple[str, str | bool | None, str], ...] = (
    ("name", None, "how results and reports call the case"),
    ("prior", None, "the surface from MRI or CT, or a label volume"),
    ("prior_of", "patient", "whose anatomy it is: patient, or template (another person or a mean)"),
    ("cap", False, "close the openings of the prior"),
    ("label", None, "label volume: the label to take"),
    ("part", None, "the named segment or volume to take"),
    ("layer", None, "4D volume: the layer or phase, from 0"),
    ("box", None, "label volume: cut to least x y z, most x y z (mm, LPS)"),
    ("fill_slices", None, "label volume: interpolate blank slices"),
    ("form", None, "NIfTI whose two forms contradict: the one that is right, sform or qform"),
    (
        "sidecar",
        None,
        "volume that a JSON file beside it contradicts: ignore or take what that says",
    ),
    (
        "image",
        None,
        "the grey image that the prior was segmented in: NIfTI, NRRD, MetaImage, or a DICOM series",
    ),
    ("points", None, "the mapping points: columns x, y, z and type (eam, ablation, landmark, inside)"),
    ("columns", None, "which columns of the points these are, where headings do not say: bipolar=V1, x=East"),
    ("prior_landmarks", None, "places named on the prior, such as veins; pairs with landmarks of the points"),
    ("units", "mm", "units of files that do not state theirs: mm, cm, m, um, in, px"),
    ("frame", "unknown", "frame of the points, and of a label volume that states none: LPS, RAS or unknown"),
    ("dimension", None, "2: outlines in place of surfaces"),
    ("notes", "", "free text"),
)
FOLDS = "parts of the points for the cross-validation: the rest is fitted once for each; 0: none, and faster"
COLUMN, WIDTH = 28, 110  # where comments begin, and where they end
# what people change most; the other parameters are in `o3dls stages NAME`
SHOWN = {
    "global_pose": ("scale", "hands"),
    "landmarks": ("scale",),
    "icp": ("preset", "metric", "scale", "reject", "keep"),
    "deform": ("outliers", "ablation", "map_shift", "odds", "contact_force"),
    "topology": ("evidence",),
    "level_set": ("spacing", "reconstruct"),
    "report": ("pdf",),
    "export": ("on",),
}


@dataclass(frozen=True)
class Inputs:
    """These are the files that a new case refers to, which stay where they are; image: a grey image of the
    prior.
    """

    prior: Path
    points: Path
    prior_landmarks: Path | None = None
    image: Path | None = None

    @property
    def given(self) -> dict[str, Path]:
        """The files that there are, by their key in case.toml."""
        return {key: path for key, path in vars(self).items() if path}


def make_case(
    folder: str | Path, inputs: Inputs, *, out: Path | None = None, force: bool = False, **settings: Any
) -> Path:
    """Make a case folder that refers to a prior and to points, with a pipeline file that runs on it; gives
    the path of that file.

    out: the run folder that the pipeline names, by
    default `run` in the folder. settings: units, frame, prior_of, cap, label, part, box, layer, fill_slices,
    form, sidecar as case.toml has them; None: not given.
    Raises InputError for all that `o3dls check` would say, and writes nothing then.
    """
    folder = Path(folder)
    files = inputs.given
    check_free(folder, force, "case", list(files.values()))
    for role, path in files.items():
        _check_file(role, path)
    run = folder / "run" if out is None else out
    _check_run(run, folder, list(files.values()))
    known = _gather_settings(folder, files, settings)
    with compiling_said():
        case = with_image(case_of(new_folder(folder, known)))
        plan = default_pipeline().allowed_by(case)
        if why := plan.refusals(case):
            raise InputError("; ".join(why))
    relative = known | {role: seen_from(path, folder) for role, path in files.items()}
    with staged_folder(folder, force) as staged:
        write_file(staged / "case.toml", CASE_HEAD + _case_lines(relative))
        write_file(staged / "pipeline.toml", _pipeline_text(plan, seen_from(run, folder)))
        write_manifest(staged)
    for line in column_table(case.columns):
        log.info("%s", line)
    return folder / "pipeline.toml"


def _gather_settings(folder: Path, files: dict[str, Path], given: dict[str, Any]) -> dict[str, Any]:
    """Return what case.toml says, with absolute paths: the folder is not there yet."""
    plain = {
        key: list(v) if isinstance(v, tuple) else v
        for key, v in given.items()
        if v is not None and v is not False
    }
    paths = {role: str(path.absolute()) for role, path in files.items()}
    outline = {"dimension": 2} if files["prior"].suffix.lower() == ".csv" else {}
    return {"name": folder.resolve().name, **paths, **plain, **outline}


def _check_file(role: str, path: Path) -> None:
    option = f"--{role.removeprefix('prior_')} {path}"
    if role == "prior":
        check_no_series(path)
    if path.is_dir() and role != "image":
        study = "; if it is the export of a study, use o3dls import" if role == "points" else ""
        raise InputError(f"{option}: is a folder; name a file{study}")
    if not path.exists():
        raise InputError(f"{option}: no such file")


def _check_run(run: Path, folder: Path, reads: list[Path]) -> None:
    if folder.resolve().is_relative_to(run.resolve()):
        raise InputError(
            f"--out {run}: is or holds the case, and a run would replace it; name another folder"
        )
    check_free(run, True, "run", reads)


def _case_lines(settings: dict[str, Any]) -> str:
    lines = []
    for key, default, words in CASE_KEYS:
        if key in settings:
            lines.append(_comment_line(toml_lines({key: settings[key]}).rstrip(), words))
        elif default is not None:
            lines.append(_comment_line("# " + toml_lines({key: default}).rstrip(), words))
    return "".join(lines)


def _comment_line(line: str, words: str) -> str:
    """Return a line with its comment: beside it, or above one that is long."""
    if len(line) > COLUMN:
        return f"# {words}\n{line}\n"
    first, *more = textwrap.wrap(words, WIDTH - COLUMN)
    return f"{line:<{COLUMN}}  # {first}\n" + "".join(f"{'':<{COLUMN}}  # {part}\n" for part in more)


def _pipeline_text(plan: Pipeline, out: str) -> str:
    blocks = [
        _plugin_block(kind, plugin)
        for kind, plugins in (("stage", plan.stages), ("write", plan.writes))
        for plugin in plugins
    ]
    return "".join(
        [
            PIPELINE_HEAD,
            _comment_line('case = "."', "this folder; another: o3dls run --case DIR"),
            _comment_line(toml_lines({"out": out}).rstrip(), "the run folder; made when the run is whole"),
            _comment_line(f"# folds = {plan.folds}", FOLDS),
            *blocks,
        ]
    )


def _plugin_block(kind: str, plugin: Plugin) -> str:
    given = [f"{key} = {as_toml(getattr(plugin, key))}" for key in sorted(plugin.model_fields_set)]
    shown = [
        _comment_line(f"# {line}", words)
        for line, words in commented(plugin.name, SHOWN.get(plugin.name, ()))
    ]
    head = "".join(f"# {line}\n" for line in textwrap.wrap(meaning(type(plugin)), WIDTH))
    return "".join(
        [f"\n{head}[[{kind}]]\n", f'use = "{plugin.name}"\n', *(f"{line}\n" for line in given), *shown]
    )
