"""Coordinates in a case folder's files, brought to mm and into the frame that is asked for."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..case import MILLIMETRES
from ..errors import Doubt, InputError, choices
from ..geometry.similarity import TURN, apply
from ..geometry.surface import Surface
from .case_settings import Folder
from .meshes.surface_file import SurfaceFile
from .table import Table

log = logging.getLogger("o3dls")
LENGTHS = [unit for unit in MILLIMETRES if unit != "px"]
HEART = (18.0, 1000.0)  # mm across: of a surface out of a heart, up to the whole of it
POSSIBLE = (1.0, 20_000.0)  # beyond it units are certainly wrong, whatever a file states
ATRIUM = 100.0  # mm across


def millimetres_per_unit(folder: Folder, path: Path, stated: str | None) -> float:
    """Return the factor to mm: what the file states, else what the case says.

    Raises InputError for units that nobody knows.
    """
    if stated not in (*MILLIMETRES, "unknown", None):
        raise InputError(f"{path}: states units '{stated}': must be one of {', '.join(MILLIMETRES)}")
    given = folder.settings.get("units", stated)
    if stated in MILLIMETRES and given != stated:
        log.info("%s: states units %s, which are taken; %s is for files that state none", path, stated, given)
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


def overruled(where: Path | str, file: SurfaceFile, given: str | None) -> SurfaceFile:
    """Return a surface whose file states units, in the `given` ones where it cannot be a heart in those that
    are stated and can in these.

    Raises InputError where it is far from a heart in the stated ones, and no others are given.
    """
    stated = str(file.metadata.get("stated_units", file.units))
    if file.surface.dimension != 3 or stated not in MILLIMETRES or "px" in (stated, given):
        return file
    diagonal = file.surface.diagonal * MILLIMETRES[file.units]
    extents = {unit: diagonal * MILLIMETRES[unit] / MILLIMETRES[stated] for unit in LENGTHS}
    if given not in (None, stated) and _is_heart(extents[str(given)]) and not _is_heart(diagonal):
        factor = MILLIMETRES[file.units] * MILLIMETRES[str(given)] / MILLIMETRES[stated]
        over = f"by which it extends over {diagonal:.3g} mm"
        said = f"states units {stated}, {over}; --units {given} overrules that"
        surface = file.surface.with_vertices(file.surface.vertices * factor)
        return replace(file, surface=surface, units="mm", notes=(*file.notes, said))
    if given is None and not POSSIBLE[0] <= diagonal <= POSSIBLE[1]:
        likely = min(extents, key=lambda unit: abs(float(np.log(extents[unit] / ATRIUM))))
        raise Doubt(
            f"{where}: states units {stated}, by which it extends over {diagonal:.3g} mm",
            f"if its units are {likely}, say --units {likely}, else --units {stated}",
            choices("units", (likely, stated), "its units are {}"),
        )
    return file


def in_units(where: Path, file: SurfaceFile, given: str | None) -> SurfaceFile:
    """Return a surface in mm by the `given` units where its file states none, else as `overruled` does.

    Raises InputError for units that nobody knows.
    """
    if given not in (*LENGTHS, None):
        raise InputError(f"units = '{given}': must be one of {', '.join(LENGTHS)}")
    file = overruled(where, file, given)
    if file.units != "unknown" or given is None:
        return file
    surface = file.surface.with_vertices(file.surface.vertices * MILLIMETRES[given])
    return replace(file, surface=surface, units="mm")


def _is_heart(extent: float) -> bool:
    return HEART[0] <= extent <= HEART[1]


def check_scale(path: Path | str, xyz: Array, smallest: float = 5.0) -> None:
    """Raise InputError where the extent of undeclared units is not that of a heart in mm (atria: 60 to 160).

    Extents that might be either are let pass. `smallest`: extent from which, up to 18, centimetres are
    likely.
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
        raise Doubt(
            f"{path}: extends over {diagonal:.3g} mm",
            f"if its units are {likely}, say --units {likely}, else --units mm",
            choices("units", (likely, "mm"), "its units are {}"),
        )


def check_common_units(
    folder: Folder, prior: SurfaceFile, table: Table, xyz: Array, least: float = 0.1, most: float = 4.0
) -> None:
    """Raise InputError where the units that are said of all files that state none make points (n, 3) and
    prior of different size, and fit one of the two alone. The points of a single vein are `least` times as
    large as a prior; `most` is beyond any.
    """
    given = folder.settings.get("units")
    if given in (None, "mm", "px") or len(xyz) == 0:
        return
    size = prior.surface.diagonal
    span = float(np.linalg.norm(np.ptp(np.quantile(xyz, (0.05, 0.95), axis=0), axis=0)))
    both = f"of {given} the points span {span:.3g} mm, the prior {size:.3g} mm"

    def fits(factor: float) -> bool:
        return least * size <= span * factor <= most * size

    if fits(1.0):
        return
    if table.notes.get("units", "unknown") not in MILLIMETRES and fits(1.0 / MILLIMETRES[given]):
        raise InputError(
            f"{table.path}: {both}; if the points are in mm, add the line '# units=mm' above the header of "
            "their file"
        )
    if prior.units not in MILLIMETRES and fits(MILLIMETRES[given]):
        raise InputError(
            f"{folder.find('prior')}: {both}; if the prior is in mm, write that into it: "
            "o3dls convert PRIOR OUT --units mm"
        )
