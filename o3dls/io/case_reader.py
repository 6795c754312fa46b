"""A case folder becomes a Case: the contract of DESIGN, read strictly."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..case import MILLIMETRES, Case, Points, no_points
from ..errors import InputError
from ..geometry.similarity import is_pose
from .case_coordinates import check_common_units, check_scale, coordinates, in_frame, millimetres_per_unit
from .case_settings import Folder, lines_said, open_folder
from .case_surfaces import phases_of, surface_of, truth_of
from .grey.of_case import image_of, with_image
from .markups import read_markups
from .points import describe_columns, points_of, read_points_table, scaled
from .table import Table, read_table
from .text import decode, hashed_reads, read_bytes, rectangle

FEWEST_POINTS = 10
log = logging.getLogger("o3dls")
MARKUPS = (".json", ".fcsv")


def read_case(
    folder: str | Path,
    *,
    points: str | Path | None = None,
    units: str | None = None,
    frame: str | None = None,
    fewest: int = FEWEST_POINTS,
) -> Case:
    """Read the case in a folder, strictly: what is missing, unknown or cannot be meant is refused.

    Parameters
    ----------
    folder : str or Path
        the case: a prior surface, a table of points, and what else docs/folders.md names.
    points : str or Path, default the table in the folder
        file of measured points to read in its place.
    units : {"mm", "cm", "m", "um", "in", "px"}, default what the files state
        unit of all lengths, where the files state none.
    frame : {"LPS", "RAS", "unknown"}, default what the files state
        frame of the points, where the files state none.
    fewest : int, default 10
        points of type eam that must be there; where it is 0 there need be no file of them.

    Returns
    -------
    Case
        `prior`, in its own frame, and `points` (n, 3) in the map frame, both in mm; in 2D (n, 2), mm or px.

    Raises
    ------
    InputError
        naming file, line and column where there is one, and what would be right.

    Examples
    --------
    >>> import o3dls
    >>> case = o3dls.read_case("case")
    >>> case.units, case.points.xyz.shape
    ('mm', (294, 3))
    """
    given = {k: v for k, v in (("units", units), ("frame", frame)) if v}
    with hashed_reads() as read, lines_said():
        opened = open_folder(Path(folder), given)
        case = case_of(opened, points, fewest)
        return replace(with_image(case), files=opened.hashes(read))


def read_kept_case(folder: Path) -> Case:
    """Read the case that a run keeps; its image may have been moved since, and is not looked at."""
    with hashed_reads() as read, lines_said():
        opened = open_folder(folder, {})
        return replace(case_of(opened), files=opened.hashes(read))


def case_of(opened: Folder, points: str | Path | None = None, fewest: int = FEWEST_POINTS) -> Case:
    """Return the case of a folder whose settings are known, without the hashes of its files; parameters and
    errors as of `read_case`.
    """
    prior = surface_of(opened, "prior")
    if prior is None:
        raise InputError(
            f"{opened.path}: no prior surface; there must be a file prior.ply (or .stl, .vtp, .mesh, "
            ".nii.gz and others)"
        )
    if fewest == 0 and points is None and opened.find("points") is None:
        measured, frame = no_points(opened.dimension), str(opened.settings.get("frame", "unknown"))
        columns: dict[str, str] = {}
    else:
        table = _read_points_table(opened, points)
        measured, frame = _read_points(opened, table, fewest), _points_frame(opened, table)
        columns = describe_columns(table)
        if opened.dimension == 3:
            check_common_units(opened, prior, table, measured.of("eam").xyz)
    case = Case(
        name=opened.settings.get("name", opened.path.resolve().name),
        prior=prior.surface,
        points=measured,
        prior_landmarks=_read_landmarks(opened, prior.space),
        init=_read_pose(opened),
        units=opened.units,
        frame=frame,
        prior_frame=prior.space,
        prior_file_units=_prior_file_units(opened, prior.units),
        image=image_of(opened, prior),
        prior_of=opened.settings.get("prior_of", "patient"),
        notes=opened.settings.get("notes", ""),
        columns=columns,
        truth=truth_of(opened, prior.space, frame),
        phases=phases_of(opened, prior.space),
    )
    _check_case(case, opened)
    return case


def _points_frame(folder: Folder, table: Table) -> str:
    """Return the frame that the points or the case state. Raises InputError where both do, and differ."""
    stated = table.notes.get("space", "unknown")
    given = str(folder.settings.get("frame", "unknown"))
    if "unknown" not in (stated, given) and stated != given:
        raise InputError(
            f"{table.path}: states frame {stated}, and --frame or case.toml says {given}; omit "
            "that, or correct the file"
        )
    return given if stated == "unknown" else stated


def _prior_file_units(folder: Folder, stated: str) -> str:
    """Return the units of the prior's own file; the case that a run keeps states them apart, as its prior is
    in mm.
    """
    said = stated if stated in MILLIMETRES else folder.settings.get("units", folder.units)
    return str(folder.settings.get("prior_file_units", said))


def _read_points_table(folder: Folder, points: str | Path | None) -> Table:
    path = folder.find("points") if points is None else Path(points)
    if path is None:
        raise InputError(
            f"{folder.path}: no points.csv; there must be one with columns "
            f"{','.join('xyz'[: folder.dimension])}"
        )
    table = read_points_table(path, folder.dimension, folder.settings.get("columns"))
    folder.note(path)
    return table


def _read_points(folder: Folder, table: Table, fewest: int) -> Points:
    if len(table) == fewest == 0:
        return no_points(folder.dimension)
    stated = table.notes.get("units", "unknown")
    points = scaled(points_of(table, folder.dimension), millimetres_per_unit(folder, table.path, stated))
    for note in points.notes:
        log.info("%s: %s", table.path, note)
    fitted = int((points.type == "eam").sum())
    if fitted < fewest:
        raise InputError(
            f"{table.path}: {fitted} points of type eam: at least {fewest} are needed to fit a surface"
        )
    if folder.dimension == 3 and "units" not in folder.settings and stated == "unknown":
        check_scale(table.path, points.xyz, np.inf)  # a few points may lie close together
    return points


def _read_landmarks(folder: Folder, space: str) -> dict[str, Array]:
    """Read places named on the prior, in its frame `space`."""
    path = folder.find("prior_landmarks")
    if path is None:
        return {}
    if path.suffix.lower() in MARKUPS:
        return _read_slicer_landmarks(folder, path, space)
    axes = tuple("xyz"[: folder.dimension])
    table = read_table(path, ("name", *axes))
    names = table.columns["name"]
    _check_unique_names(names, [table.where(row, "name") for row in range(len(names))])
    return dict(zip(names, coordinates(folder, table, axes, space), strict=True))


def _read_slicer_landmarks(folder: Folder, path: Path, space: str) -> dict[str, Array]:
    """Read places that Slicer named on the prior."""
    if folder.dimension != 3 or folder.units == "px":
        raise InputError(
            f"{path}: Slicer's markups are places in 3D, in mm; write a table name,x,y in their place"
        )
    marks = read_markups(path)
    _check_unique_names(marks.names, [str(path)] * len(marks.names))
    return dict(zip(marks.names, in_frame(marks.xyz, marks.space, space), strict=True))


def _check_unique_names(names: Sequence[str], places: Sequence[str]) -> None:
    for row, (name, where) in enumerate(zip(names, places, strict=True)):
        if not name or name in names[:row]:
            fault = "appears twice" if name else "is empty"
            raise InputError(f"{where}: '{name}' {fault}; each landmark needs a name of its own")


def _read_pose(folder: Folder) -> Array | None:
    """Read the rough pose prior -> map, translation scaled to mm."""
    path = folder.find("init")
    if path is None:
        return None
    n = folder.dimension + 1
    matrix = rectangle(
        [line.replace(",", " ") for line in decode(read_bytes(path), path).splitlines() if line.strip()]
    )
    if matrix is None or matrix.shape != (n, n) or not np.isfinite(matrix).all():
        raise InputError(f"{path}: must hold {n} rows of {n} finite numbers, without a header")
    if not is_pose(matrix, folder.dimension):
        raise InputError(
            f"{path}: is not a pose: must be a rotation, a shift and one scale, with "
            f"{np.eye(n)[-1].tolist()} as the last row"
        )
    matrix[:-1, -1] *= folder.scale()
    return matrix


def _check_case(case: Case, folder: Folder) -> None:
    """Raise InputError for what only the whole case shows: landmarks without a pair, outlier rows out of
    range.
    """
    marks = case.points.of("landmark")
    names = [str(name) for name in marks.columns.get("name", np.full(len(marks), ""))]
    for name in names:
        if not name or names.count(name) > 1:
            raise InputError(
                f"{folder.path}: two landmarks of the points are named '{name}'; each needs a name of its own"
            )
    if names and case.prior_landmarks and not case.landmark_partners():
        raise InputError(
            f"{folder.path}: no landmark of the points ({', '.join(names)}) has its pair in "
            "prior_landmarks.csv "
            f"({', '.join(case.prior_landmarks)}); give both sides the same names"
        )
    rows = case.truth.outliers if case.truth else None
    if rows is not None and len(wrong := rows[(rows < 0) | (rows >= len(case.points))]):
        raise InputError(
            f"{folder.path}: outliers.csv names row {wrong[0]}: points have rows 0 to {len(case.points) - 1}"
        )
