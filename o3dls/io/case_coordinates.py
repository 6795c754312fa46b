"""Coordinates in a case folder's files, brought to mm and into the frame that is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..case import MILLIMETRES
from ..errors import InputError
from ..geometry.similarity import TURN, apply
from ..geometry.surface import Surface
from .case_settings import Folder
from .meshes.surface_file import SurfaceFile
from .table import Table


def millimetres_per_unit(folder: Folder, path: Path, stated: str | None) -> float:
    """Return the factor to mm: what the file states, else what the case says.

    Raises InputError for units that nobody knows.
    """
    if stated not in (*MILLIMETRES, "unknown", None):
        raise InputError(f"{path}: states units '{stated}': must be one of {', '.join(MILLIMETRES)}")
    return folder.scale(stated)


def in_millimetres(folder: Folder, path: Path, file: SurfaceFile) -> SurfaceFile:
    """Return the file with its surface in mm."""
    return replace(
        file,
        surface=file.surface.with_vertices(
            file.surface.vertices * millimetres_per_unit(folder, path, file.units)
        ),
    )


def in_frame(xyz: Array, stated: str | None, space: str) -> Array:
    """Return the coordinates (n, d) of a file that states its frame, in the frame `space`.

    As they are where one of the two is not known.
    """
    d = xyz.shape[1]
    return apply(TURN[: d + 1, : d + 1], xyz) if {stated, space} == {"LPS", "RAS"} else xyz


def surface_in_frame(file: SurfaceFile, space: str) -> Surface:
    """Return the surface of a file in the frame `space`, as `in_frame`."""
    return file.surface.with_vertices(in_frame(file.surface.vertices, file.space, space))


def coordinates(folder: Folder, table: Table, names: Sequence[str], space: str) -> Array:
    """Return coordinates (n, d) out of columns of a table, in mm and in the frame `space`."""
    xyz = np.column_stack([table.numbers(name) for name in names]) * millimetres_per_unit(
        folder, table.path, table.notes.get("units")
    )
    return in_frame(xyz, table.notes.get("space"), space)


def check_scale(path: Path | str, xyz: Array, smallest: float = 5.0, option: str = "--units ") -> None:
    """Raise InputError where the extent of undeclared units is not that of a heart in mm (atria: 60 to 160).

    Extents that might be either are let pass. `smallest`: extent from which, up to 18, centimetres are
    likely. `option` is how the units are said.
    """
    diagonal = float(np.linalg.norm(np.ptp(xyz, axis=0)))
    inches = 1 <= diagonal < 5
    centimetres = smallest <= diagonal <= 18
    likely = (
        "m"
        if diagonal < 1
        else "in"
        if inches
        else "cm"
        if centimetres
        else "um"
        if diagonal > 20_000
        else None
    )
    if likely:
        raise InputError(
            f"{path}: extends over {diagonal:.3g} mm; if its units are {likely}, say {option}{likely}, "
            f"else {option}mm"
        )
