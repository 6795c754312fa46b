"""EnSite CSV exports: measured points of a map (DxL), lesions, and the cloud of catheter positions behind the
shell.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...case import Points
from ...columns import GROUP
from ...errors import InputError
from ..meshes.surface_file import SurfaceFile
from ..text import cells_of, check_numbers, decode, is_missing
from .imported import joined

# first part of the map type -> columns that hold its value
VALUES = {
    "PP": ("P-P",),
    "LAT": ("LAT", "adjTime (ms)"),
}
NUMBER = "(Point #)"
MOMENT = "Freeze Grp #"  # points of all electrodes that were taken when the operator froze the signals
LESION_XYZ = (("x", "y", "z"), ("X", "Y", "Z"))
LESION_VALUES = {
    "Avg Contact Force (g)": "force",
    "Energy": "energy_j",
    "FTI": "fti_gs",
    "LSI": "lsi",
    "Avg Power": "power_w",
}


@dataclass(frozen=True, eq=False)
class Export:
    """An export is one CSV file of the system: `key: value` lines of the preamble, the column names, and rows
    with their line numbers.
    """

    path: Path
    preamble: dict[str, str]
    header: list[str]
    rows: list[tuple[int, list[str]]]

    def column(self, name: str) -> list[str]:
        return [row[self.header.index(name)] for _, row in self.rows]

    def numbers(self, name: str) -> Array:
        """Return a column as numbers; `invalid`, empty and infinite cells are NaN. Raises InputError naming
        line and column.
        """
        values = []
        for (line, _), cell in zip(self.rows, self.column(name), strict=True):
            text = "nan" if not cell.strip() or is_missing(cell.strip()) else cell
            check_numbers([text], 1, f"{self.path}: line {line}, column '{name}'", "value")
            values.append(float(text) if np.isfinite(float(text)) else np.nan)
        return np.array(values)

    def xyz(self, names: Sequence[str], used: NDArray[np.bool_] | None = None) -> Array:
        """Return places (n, 3). Raises InputError where one, of the rows that are `used`, is not finite."""
        xyz = np.column_stack([self.numbers(name) for name in names]).reshape(-1, 3)
        bad = np.flatnonzero(~np.isfinite(xyz).all(axis=1) & (True if used is None else used))
        if len(bad):
            raise InputError(
                f"{self.path}: line {self.rows[bad[0]][0]}: position {xyz[bad[0]]} is not finite"
            )
        return xyz


def knows(data: bytes) -> bool:
    return re.match(rb"(\xef\xbb\xbf)?Export File Version", data) is not None or b"roving x" in data[:100_000]


def parse(path: Path, data: bytes, required: Sequence[str]) -> Export:
    """Parse the table of an export, found by its column names, not by the row that the preamble states.
    Raises InputError.
    """
    lines = decode(data, path).splitlines()
    start, header, comma = _find_header(path, lines, required)
    if start is None:
        raise InputError(f"{path}: has no line with the columns {', '.join(required)}")
    found = (re.match(rf"\s*([^:*{comma}]+?)\s*:\s*{comma}?\s*([^{comma}]*)", line) for line in lines[:start])
    preamble = {match[1]: match[2] for match in found if match}
    rows = []
    for number, line in enumerate(lines[start + 1 :], start + 2):
        if line.strip().rstrip(comma) == "EOF":
            break
        if line.strip():
            cells = cells_of(line, comma, f"{path}: line {number}")
            if len(cells) < len(header) - 1:  # the last name often stands for any number of samples
                raise InputError(
                    f"{path}: line {number} has {len(cells)} cells: the columns are {len(header)}"
                )
            rows.append((number, cells + [""] * (len(header) - len(cells))))
    else:
        stated = preamble.get("# mapping pts", "")
        # without EOF, the stated count and an ended last line show that the file is whole
        whole = stated == str(len(rows)) and data.endswith((b"\n", b"\r"))
        if "Export File Version" in preamble and not whole:
            raise InputError(
                f"{path}: line {len(lines)}: ends without EOF, after {len(rows)} of "
                f"{stated or 'an unknown number of'} points; the file is truncated: export it again"
            )
    return Export(path, preamble, header, rows)


def _find_header(
    path: Path, lines: Sequence[str], required: Sequence[str]
) -> tuple[int | None, list[str], str]:
    """Return the first line that has all the columns, with its names stripped, and what parts them; a name
    that comes again counts once.
    """
    for number, line in enumerate(lines[:2000]):
        if required[0] in line:
            comma = max(",;", key=line.count)  # spreadsheets write semicolons in some countries
            names = [cell.strip() for cell in cells_of(line, comma, f"{path}: line {number + 1}")]
            if set(required) <= set(names):
                return number, names, comma
    return None, [], ","


def read_map(path: Path, data: bytes) -> tuple[Points, dict[str, str]]:
    """Read utilised points of a DxL map at the roving electrode (not projected), and the preamble. Raises
    InputError.
    """
    places = ("roving x", "roving y", "roving z")
    export = parse(path, data, places)
    used = _utilised_rows(export)
    xyz = export.xyz(places, used)[used]
    columns = _map_values(export)
    if NUMBER in export.header:
        columns[NUMBER] = export.numbers(NUMBER)
    if "force (g)" in export.header:
        columns["force"] = export.numbers("force (g)")
    if MOMENT in export.header:
        columns[GROUP] = export.numbers(MOMENT)
    columns = {name: values[used] for name, values in columns.items()}
    return Points(xyz, np.full(len(xyz), "eam"), columns), export.preamble


def by_number(first: Points, second: Points) -> Points | None:
    """Return the points of two exports of one map, which need not use the same rows, joined by their numbers;
    a value that only one has is NaN elsewhere. A number that comes more than once, as one does for all
    electrodes of a catheter at one moment, is joined by the place as well.

    None where a number is missing, no point is in both, or one that is in both differs.
    """
    numbers = [points.columns.get(NUMBER, np.full(len(points), np.nan)) for points in (first, second)]
    if any(np.isnan(n).any() for n in numbers):
        return None
    keys = [_row_keys(n, points.xyz) for n, points in zip(numbers, (first, second), strict=True)]
    both_have, mine, theirs = np.intersect1d(keys[0], keys[1], return_indices=True)
    alone = [values[counts == 1] for values, counts in (np.unique(n, return_counts=True) for n in numbers)]
    moved = np.setdiff1d(np.intersect1d(alone[0], alone[1]), numbers[0][mine])
    shared = first.columns.keys() & second.columns.keys()
    alike = len(moved) == 0 and all(
        np.array_equal(first.columns[name][mine], second.columns[name][theirs], equal_nan=True)
        for name in shared
    )
    if len(both_have) == 0 or not alike:
        return None
    both = joined(first, second.select(~np.isin(np.arange(len(second)), theirs)))
    for name in second.columns.keys() - first.columns.keys():
        both.columns[name][mine] = second.columns[name][theirs]
    return both.select(np.argsort(both.columns[NUMBER], kind="stable"))


def _row_keys(numbers: Array, xyz: Array) -> NDArray[Any]:
    """Return a key (n,) of each row: its number, its place, and how many such rows stand before it."""
    rows = np.column_stack([numbers, xyz])
    _, same = np.unique(rows, axis=0, return_inverse=True)
    order = np.argsort(same.ravel(), kind="stable")
    ranked = same.ravel()[order]
    before = np.empty(len(rows))
    before[order] = np.arange(len(rows)) - np.searchsorted(ranked, ranked)
    return np.ascontiguousarray(np.column_stack([rows, before])).view([("", float)] * 5).ravel()


def _utilised_rows(export: Export) -> NDArray[np.bool_]:
    """Return the rows that the map uses: all where the export does not say."""
    if "utilized" not in export.header:
        return np.ones(len(export.rows), dtype=bool)
    return utilised(str(export.path), export.numbers("utilized"), lambda row: f"line {export.rows[row][0]}")


def utilised(where: str, marks: Array, place: Callable[[int], str]) -> NDArray[np.bool_]:
    """Return which points the map uses. Raises InputError where one does not say; `place` names it."""
    blank = np.flatnonzero(np.isnan(marks))
    if len(blank):
        raise InputError(
            f"{where}: {place(int(blank[0]))}: 'utilized' is blank, in {len(blank)} of "
            f"{len(marks)} points: must be 1 or 0; without it every point is taken"
        )
    return np.asarray(marks == 1)


def map_column(export: Export) -> tuple[str, str] | None:
    """Return the heading of the map's own value, and its name by what the map is: `PP_bi` is bipolar,
    `PP_uni` unipolar, `LAT_...` lat; None where there is none.
    """
    kind = export.preamble.get("Map type", "")
    first, _, source = kind.partition("_")
    column = next((name for name in VALUES.get(first, (first,)) if name in export.header), None)
    if column is None:
        return None
    voltage = {"bi": "bipolar", "uni": "unipolar"}.get(source, kind) if first == "PP" else kind
    return column, "lat" if first == "LAT" else voltage


def _map_values(export: Export) -> dict[str, NDArray[Any]]:
    """Return the map's own value by its name, NaN where the export says that it is not valid."""
    found = map_column(export)
    if found is None:
        return {}
    column, name = found
    values = export.numbers(column)
    valid = f"{column} valid"
    return {name: np.where(export.numbers(valid) == 1, values, np.nan) if valid in export.header else values}


def read_lesions(path: Path, data: bytes) -> Points:
    """Read ablation points of Lesions.csv or AutoMark_Data.csv. Raises InputError."""
    export, places = parse_lesions(path, data)
    xyz = export.xyz(places)
    columns: dict[str, NDArray[Any]] = {
        ours: export.numbers(theirs) for theirs, ours in LESION_VALUES.items() if theirs in export.header
    }
    return Points(xyz, np.full(len(xyz), "ablation"), columns)


def parse_lesions(path: Path, data: bytes) -> tuple[Export, tuple[str, ...]]:
    """Return the table of ablation points, and the names of its columns of places. Raises InputError."""
    for places in LESION_XYZ:
        if _find_header(path, decode(data, path).splitlines(), places)[0] is not None:
            return parse(path, data, places), places
    raise InputError(f"{path}: has no columns x, y, z")


def read_cloud(path: Path, data: bytes) -> Points:
    """Read catheter positions of Model_Point_Cloud.csv in the frame of the shell: they lie inside the
    chamber. Raises InputError.
    """
    export = parse(path, data, ("trn_x", "trn_y", "trn_z"))
    xyz = export.xyz(("trn_x", "trn_y", "trn_z"))
    return Points(xyz, np.full(len(xyz), "inside"))


def landmarks_of(shell: SurfaceFile) -> dict[str, Array]:
    """Return the labels of a DIF shell as landmarks of the map."""
    return {name: np.array(xyz) for name, xyz in shell.metadata.get("labels", {}).items() if name}
