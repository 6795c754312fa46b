"""EnSite CSV exports: measured points of a map (DxL), lesions, and the cloud of catheter positions behind the
shell.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...case import Points
from ...errors import InputError
from ..meshes.surface_file import SurfaceFile
from ..text import cells_of, check_numbers, decode
from .imported import joined

# first part of the map type -> columns that hold its value
VALUES = {
    "PP": ("P-P",),
    "LAT": ("LAT", "adjTime (ms)"),
}
NUMBER = "(Point #)"
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
            text = "nan" if cell.strip().lower() in ("", "invalid", "n/a") else cell
            check_numbers([text], 1, f"{self.path}: line {line}, column '{name}'", "value")
            values.append(float(text) if np.isfinite(float(text)) else np.nan)
        return np.array(values)

    def xyz(self, names: Sequence[str]) -> Array:
        xyz = np.column_stack([self.numbers(name) for name in names]).reshape(-1, 3)
        bad = np.flatnonzero(~np.isfinite(xyz).all(axis=1))
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
    xyz = export.xyz(places)
    used = _utilised_rows(export) if "utilized" in export.header else np.ones(len(xyz), dtype=bool)
    columns = _map_values(export)
    if NUMBER in export.header:
        columns[NUMBER] = export.numbers(NUMBER)
    if "force (g)" in export.header:
        columns["force"] = export.numbers("force (g)")
    return Points(xyz, np.full(len(xyz), "eam"), columns).select(used), export.preamble


def by_number(first: Points, second: Points) -> Points | None:
    """Return the points of two exports of one map, which need not use the same rows, joined by their numbers;
    a value that only one has is NaN elsewhere. None where a number is missing or comes twice, none is in
    both, or one that is in both differs.
    """
    numbers = [points.columns.get(NUMBER, np.full(len(points), np.nan)) for points in (first, second)]
    if any(np.isnan(n).any() or len(np.unique(n)) < len(n) for n in numbers):
        return None
    _, one, other = np.intersect1d(numbers[0], numbers[1], assume_unique=True, return_indices=True)
    shared = first.columns.keys() & second.columns.keys()
    alike = np.array_equal(first.xyz[one], second.xyz[other]) and all(
        np.array_equal(first.columns[name][one], second.columns[name][other], equal_nan=True)
        for name in shared
    )
    if len(one) == 0 or not alike:
        return None
    both = joined(first, second.select(~np.isin(numbers[1], numbers[0])))
    for name in second.columns.keys() - first.columns.keys():
        both.columns[name][one] = second.columns[name][other]
    return both.select(np.argsort(both.columns[NUMBER]))


def _utilised_rows(export: Export) -> NDArray[np.bool_]:
    """Return the rows that the map uses. Raises InputError where a row does not say."""
    marks = export.numbers("utilized")
    blank = np.flatnonzero(np.isnan(marks))
    if len(blank):
        raise InputError(
            f"{export.path}: line {export.rows[blank[0]][0]}: 'utilized' is blank, in {len(blank)} of "
            f"{len(marks)} rows: must be 1 or 0; without the column every point is taken"
        )
    return np.asarray(marks == 1)


def _map_values(export: Export) -> dict[str, NDArray[Any]]:
    """Return the map's own value, named by what the map is: `PP_bi` is bipolar, `PP_uni` unipolar, `LAT_...`
    lat.
    """
    kind = export.preamble.get("Map type", "")
    first, _, source = kind.partition("_")
    column = next((name for name in VALUES.get(first, (first,)) if name in export.header), None)
    if column is None:
        return {}
    name = (
        "lat"
        if first == "LAT"
        else {"bi": "bipolar", "uni": "unipolar"}.get(source, kind)
        if first == "PP"
        else kind
    )
    values = export.numbers(column)
    valid = f"{column} valid"
    return {name: np.where(export.numbers(valid) == 1, values, np.nan) if valid in export.header else values}


def read_lesions(path: Path, data: bytes) -> Points:
    """Read ablation points of Lesions.csv or AutoMark_Data.csv. Raises InputError."""
    for places in LESION_XYZ:
        if _find_header(path, decode(data, path).splitlines(), places)[0] is not None:
            export = parse(path, data, places)
            xyz = export.xyz(places)
            columns: dict[str, NDArray[Any]] = {
                ours: export.numbers(theirs)
                for theirs, ours in LESION_VALUES.items()
                if theirs in export.header
            }
            return Points(xyz, np.full(len(xyz), "ablation"), columns)
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
