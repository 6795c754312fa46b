"""The surfaces of a case folder, and what else it holds of the truth: held-out places, correspondence,
outliers.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..case import MILLIMETRES, Truth
from ..errors import InputError
from ..geometry.surface import Surface
from .case_coordinates import check_scale, coordinates, in_millimetres, overruled, surface_in_frame
from .case_settings import Folder
from .meshes.repair import closed_outward
from .meshes.surface_file import SurfaceFile
from .surfaces import read_surface_file, write_surface
from .table import Table, write_table
from .text import integers

# settings that choose a surface of the prior's file
CHOICE = ("label", "part", "box", "layer", "fill_slices", "form", "sidecar")
log = logging.getLogger("o3dls")


def surface_of(folder: Folder, role: str) -> SurfaceFile | None:
    """Return the surface of a role in mm, None where there is no such file; the prior is closed and
    outward.
    """
    path = folder.find(role)
    if path is None:
        return None
    choice = {key: folder.settings.get(key) for key in CHOICE} if role == "prior" else {}
    file = _read_in_millimetres(folder, path, **choice)
    surface = file.surface
    if surface.dimension != folder.dimension:
        hint = f"say dimension = {surface.dimension} in case.toml"
        raise InputError(f"{path}: is {surface.dimension}D, the case is {folder.dimension}D; {hint}")
    if role != "prior":  # a truth may be open: it is only measured against
        return file
    if "units" not in folder.settings and file.units not in MILLIMETRES:
        check_scale(path, surface.vertices)
    return replace(file, surface=closed_outward(surface, str(path), cap=folder.settings.get("cap", False)))


def _read_in_millimetres(folder: Folder, path: Path, **choice: Any) -> SurfaceFile:
    """Read the surface of a file in mm; what of the file is not in it goes to the log."""
    file = read_surface_file(path, **_stated_settings(folder), **choice)
    file = overruled(path, file, folder.settings.get("units"))
    for note in file.notes:
        log.info("%s: %s", path, note)
    return in_millimetres(folder, path, file)


def _stated_settings(folder: Folder) -> dict[str, str | None]:
    """Return what the case says of files that do not say it themselves."""
    return {key: folder.settings.get(key) for key in ("units", "frame")}


def phases_of(folder: Folder, space: str) -> tuple[Surface, ...]:
    """Return the surfaces in the folder phases/, in the order of their names and in the prior's frame
    `space`.
    """
    found = []
    for path in sorted(
        p for p in (folder.path / "phases").glob("*") if p.is_file() and not p.name.startswith(".")
    ):
        surface = surface_in_frame(_read_in_millimetres(folder, path), space)
        if surface.dimension != folder.dimension:
            raise InputError(f"{path}: is {surface.dimension}D, the case is {folder.dimension}D")
        folder.note(path)
        found.append(surface)
    return tuple(found)


def truth_of(folder: Folder, prior: str, frame: str) -> Truth | None:
    """Return what the folder holds for evaluation, in the frame of the points; None where it holds nothing.

    `frame` names the frame of the points, `prior` that of the prior.
    """
    axes = tuple("xyz"[: folder.dimension])
    surface = surface_of(folder, "truth")
    held = folder.table("held_out", axes)
    outliers = folder.table("outliers", ("row",))
    pairs = folder.table("correspondence", _pair_names(axes))
    if all(part is None for part in (surface, held, pairs, outliers)):
        return None
    return Truth(
        surface=None if surface is None else surface_in_frame(surface, frame),
        held_out=None if held is None else coordinates(folder, held, axes, frame),
        unseen=None if held is None or "unseen" not in held.columns else held.numbers("unseen") > 0,
        correspondence=None
        if pairs is None
        else (_read_pair_side(folder, pairs, "p", prior), _read_pair_side(folder, pairs, "t", frame)),
        outliers=None
        if outliers is None
        else integers(outliers.numbers("row"), f"{outliers.path}: column 'row'"),
    )


def _read_pair_side(folder: Folder, pairs: Table, side: str, space: str) -> Array:
    return coordinates(folder, pairs, [side + axis for axis in "xyz"[: folder.dimension]], space)


def write_truth(out: Path, truth: Truth, axes: tuple[str, ...], suffix: str, units: str) -> None:
    """Write whatever the case holds for evaluation."""
    if truth.surface is not None:
        write_surface(out / f"truth.{suffix}", truth.surface, units=units)
    if truth.held_out is not None:
        unseen = {} if truth.unseen is None else {"unseen": truth.unseen.astype(int)}
        write_table(out / "held_out.csv", {**dict(zip(axes, truth.held_out.T, strict=True)), **unseen})
    if truth.correspondence is not None:
        columns = np.concatenate([side.T for side in truth.correspondence])
        write_table(out / "correspondence.csv", dict(zip(_pair_names(axes), columns, strict=True)))
    if truth.outliers is not None:
        write_table(out / "outliers.csv", {"row": truth.outliers})


def _pair_names(axes: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(side + axis for side in "pt" for axis in axes)
