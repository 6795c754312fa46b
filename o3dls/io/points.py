"""Measured points from tables and clouds and to CSV: the columns of the case contract, by name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Mask, masked_in, without_masked
from ..case import POINT_TYPES, Points
from ..columns import ALIASES, NAMES, Chosen, described, meaning_of, read_choice
from ..errors import InputError, did_you_mean
from ..quantities import check_possible, scaled_known
from .clouds.registry import cloud_table
from .table import LARGEST_TABLE, Table, table_of, write_table
from .text import as_utf8, read_bytes

NUMBERS = ("bipolar", "unipolar", "lat", "impedance", "force", "sigma")


def read_points(path: str | Path, dimension: int = 3) -> Points:
    """Read measured points from a table or a cloud.

    Parameters
    ----------
    path : str or Path
        table (CSV, XLSX) with columns `x`, `y`, `z` and, where known, `type` (default eam), `name` and
        electrical values; other columns are kept. Or a cloud (PLY, VTK, VTP, PCD, XYZ, openCARP).
    dimension : {3, 2}, default 3
        in 2D there need be no column `z`.

    Returns
    -------
    Points
        `xyz` (n, dimension) in the unit and frame of the file, `type` (n,), and `columns` by name, (n,) each.

    Raises
    ------
    InputError
        naming file, line and column where a cell cannot be used.

    Examples
    --------
    >>> import o3dls
    >>> points = o3dls.read_points("case/points.csv")
    >>> points.xyz.shape, points.of("eam").xyz.shape
    ((294, 3), (250, 3))
    """
    table = read_points_table(path, dimension)
    return points_of(table, dimension)


def read_points_table(path: str | Path, dimension: int = 3, columns: str | None = None) -> Table:
    """Read the raw table behind `read_points`; its notes hold `space` and `units` where the file states
    them. columns: `name=heading, ...`, where headings do not say what they are.
    """
    return points_table_of(as_utf8(read_bytes(path, LARGEST_TABLE)), Path(path), dimension, columns)


def points_table_of(data: bytes, path: Path, dimension: int = 3, columns: str | None = None) -> Table:
    """Return the table in the bytes of a file, which `path` names in errors; as `read_points_table`."""
    given = read_choice(columns or "", str(path))
    found = cloud_table(path, data, NAMES)
    table = table_of(data, path, "xyz"[:dimension], Chosen(given), ask=not given) if found is None else found
    there = {heading.lower() for heading in table.headings.values()}
    for heading, name in given.items():
        if heading not in there:
            raise InputError(
                f"{path}: columns = '{name}={heading}': no such column; there are: "
                f"{', '.join(table.headings.values())[:200]}"
            )
    units = {meant.unit for axis in "xyz" if (meant := meaning_of(table.headings.get(axis, axis)))} - {""}
    stated = table.notes.get("units", "mm")
    if units and stated not in (*units, "unknown"):
        raise InputError(
            f"{path}: states units={stated}, and the headings of its coordinates say {', '.join(units)}: "
            "correct one of them"
        )
    return replace(table, notes={**table.notes, "units": units.pop()}) if units else table


def describe_columns(table: Table) -> dict[str, str]:
    """Return what became of each column of a table, by its heading."""
    kinds = {name: _read_column(table, name).dtype.kind for name in table.columns if name not in ALIASES}
    return {
        table.headings.get(name, name): described(
            table.headings.get(name, name), _scaled_name(table, name), kinds.get(name, "U")
        )
        for name in table.columns
    }


def _scaled_name(table: Table, name: str) -> str:
    """Return what a column becomes whose heading states another unit, where that name is free."""
    meant = meaning_of(name)
    return name if meant is None or meant.factor == 1.0 or meant.name in table.columns else meant.name


def points_of(table: Table, dimension: int) -> Points:
    """Return points from a table that has the columns x, y and, in 3D, z; their notes say which numbers stood
    for none.
    """
    if len(table) == 0:
        raise InputError(f"{table.path}: has a header but no points")
    axes = tuple("xyz"[:dimension])
    xyz = np.column_stack([table.numbers(axis) for axis in axes])
    columns = {
        _scaled_name(table, name): _read_column(table, name)
        for name in table.columns
        if name not in (*axes, "type")
    }
    return _check_measured(Points(xyz, _read_types(table), columns), str(table.path), table.place)


def _read_column(table: Table, name: str) -> NDArray[Any]:
    if name == "name":
        return np.array(table.columns[name], dtype=str)
    if (scaled := _scaled_name(table, name)) != name:
        return _in_own_unit(name, table.numbers(name, missing=True), ())[1]
    return table.numbers(name, missing=True) if scaled in NUMBERS else table.values(name)


def _check_measured(points: Points, where: str, place: Callable[[int], str]) -> Points:
    """Return the points unchanged. Raises InputError for what cannot have been measured."""
    for name, values in points.columns.items():
        if name == "sigma" and (values <= 0.0).any():
            row = int(np.argmax(values <= 0.0))
            raise InputError(
                f"{where}: {place(row)}, column 'sigma': a noise level must be above 0, not {values[row]:g}; "
                "leave it empty where it is unknown"
            )
        check_possible(name, values, where, place)
    return points


def _read_types(table: Table) -> NDArray[np.str_]:
    """Read the type of every point; a file without the column holds eam points only."""
    if "type" not in table.columns:
        return np.full(len(table), "eam")
    for row, kind in enumerate(table.columns["type"]):
        if kind not in POINT_TYPES:
            raise InputError(
                f"{table.where(row, 'type')}: '{kind}' is not a type of point"
                + did_you_mean(kind, list(POINT_TYPES))
            )
    return np.array(table.columns["type"], dtype=str)


def points_from(columns: Mapping[str, ArrayLike], where: str) -> Points:
    """Return points from arrays by column, named and checked as those of a file are; missing numbers are NaN.
    Rows whose place is masked are left out, and the notes say how many; a masked value is missing.

    `where` names them in errors. Raises InputError.
    """
    masked = _masked_places(columns)
    own = {str(name) for name in columns} & NAMES.keys()
    named = [
        (str(name) if (meant := NAMES.get(str(name), str(name))) in own else meant, _as_array(values, where))
        for name, values in columns.items()
    ]
    named = [_in_own_unit(name, values, {name for name, _ in named}) for name, values in named]
    found = dict(named)
    axes = [axis for axis in "xyz" if axis in found]
    if axes[:2] != ["x", "y"] or len(found) < len(named):
        raise InputError(
            f"{where}: columns are {', '.join(map(str, columns))}: there must be x, y, z, and each name once"
        )
    shapes = [found[axis].shape for axis in axes]
    if len(set(shapes)) > 1 or len(shapes[0]) != 1:
        raise InputError(f"{where}: {', '.join(axes)} have shapes {shapes}: must be columns of one length")
    for name in found.keys() & {*axes, *NUMBERS}:
        found[name] = _as_numbers(name, found[name], where)
    rows = np.arange(len(found["x"]))
    said: tuple[str, ...] = ()
    if len(masked) == len(rows) and masked.any():
        rows = rows[~masked]
        said = (f"{masked.sum()} of {len(masked)} rows are masked, and are left out",)
        found = {name: values[~masked] for name, values in found.items()}
    bad = int((~np.isfinite([found[axis] for axis in axes]).all(axis=0)).sum())
    if bad:
        raise InputError(f"{where}: {bad} points are not finite; remove them")
    kinds = found.pop("type", np.full(len(found["x"]), "eam"))
    points = Points(np.column_stack([found.pop(axis) for axis in axes]), kinds, found, notes=said)
    return _check_measured(points, where, lambda row: f"row {rows[row]}")


def _masked_places(columns: Mapping[str, ArrayLike]) -> Mask:
    """Return the rows in which a coordinate is masked; none of them where no coordinate has a mask."""
    masks = [masked_in(values) for name, values in columns.items() if str(name).lower() in "xyz"]
    there = [mask for mask in masks if mask is not None] or [np.zeros(0, dtype=bool)]
    return np.asarray(np.logical_or.reduce(there))


def _in_own_unit(name: str, values: NDArray[Any], taken: Collection[str]) -> tuple[str, NDArray[Any]]:
    """Return name and values of a column in the unit of a case, where its name states another."""
    meant = meaning_of(name)
    if meant is None or meant.factor == 1.0 or meant.name in taken or values.dtype.kind not in "fiu":
        return name, values
    return meant.name, scaled_known(np.asarray(values, dtype=np.float64), meant.factor)


def _as_array(values: ArrayLike, where: str) -> NDArray[Any]:
    try:
        return without_masked(values)
    except ValueError as error:  # the rows have different lengths
        raise InputError(f"{where}: a column is not an array: {error}") from None


def _as_numbers(name: str, values: NDArray[Any], where: str) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{where}: column '{name}' holds {values.dtype}: must be numbers") from None


def scaled(points: Points, factor: float) -> Points:
    """Return the same points in another unit of length: their places and their noise levels."""
    columns = {
        name: values * factor if name == "sigma" else values for name, values in points.columns.items()
    }
    return replace(points, xyz=points.xyz * factor, columns=columns)


def write_points(
    path: str | Path, points: Points, *, space: str | None = None, units: str | None = None
) -> None:
    """Write points as CSV that `read_points` reads back equal.

    Parameters
    ----------
    path : str or Path
        the file to write; one that is there is replaced.
    points : Points
        its coordinates, types and columns are written as they are.
    space : {"LPS", "RAS", "unknown"}, default None
        frame of the points, stated in a comment line; None: not stated.
    units : str, default None
        unit of the coordinates, stated in a comment line; None: not stated.

    Raises
    ------
    InputError
        where the file cannot be written.

    Examples
    --------
    >>> import o3dls
    >>> points = o3dls.read_points("case/points.csv")
    >>> o3dls.write_points("mapping.csv", points.of("eam"), space="LPS", units="mm")
    """
    axes = dict(zip("xyz", points.xyz.T, strict=False))
    notes = {key: value for key, value in (("space", space), ("units", units)) if value}
    write_table(path, {**axes, "type": points.type, **points.columns}, notes)
