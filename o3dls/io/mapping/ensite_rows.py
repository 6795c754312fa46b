"""The older DxL exports of EnSite (Velocity, Precision): a row for each quantity, a column for each point, in
several files of one map.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...case import Points
from ...errors import InputError
from ..text import cells_of, decode, is_missing, number
from .ensite import NUMBER, utilised
from .imported import joined

PLACES = ("roving x", "roving y", "roving z")
FIRST = re.compile(r'^\s*"?pt number"?\s*:', re.MULTILINE)
COUNT = re.compile(r"Total number of data points[^:]*:[\s,;]*(\d+)")
PART = re.compile(r'This is file (\d+) of (\d+) for map[\s,;:]*"?(.*?)["\s,;]*$', re.MULTILINE)
END = re.compile(r"\s*(Seg data len|EOF)|[\s,;]*$")
MILLISECONDS = 1000.0  # times are in seconds


@dataclass(frozen=True, eq=False)
class Part:
    """A part is one file of a map: its points, the name of the map, and which of how many files it is."""

    path: Path
    points: Points
    map_name: str
    part: int
    parts: int


def knows(data: bytes) -> bool:
    text = data[:100_000].decode("latin-1")
    return FIRST.search(text) is not None and "roving x" in text


def read_part(path: Path, data: bytes) -> Part:
    """Read the points that the map uses, at the roving electrode, from one file. Raises InputError where it
    ends early or a row does not fit.
    """
    text = decode(data, path)
    rows = _read_rows(path, text)
    found = PART.search(text)
    part, parts, name = (int(found[1]), int(found[2]), found[3].strip()) if found else (1, 1, "")
    xyz = np.column_stack([rows[axis] for axis in PLACES]).reshape(-1, 3)
    used = utilised(str(path), rows.get("utilized", np.ones(len(xyz))), "column {}".format)
    bad = np.flatnonzero(used & ~np.isfinite(xyz).all(axis=1))
    if len(bad):
        raise InputError(f"{path}: column {bad[0] + 2}: position {xyz[bad[0]]} is not finite")
    columns = {NUMBER: rows["pt number"]}
    if "peak2peak" in rows:
        columns["bipolar"] = rows["peak2peak"]
    if {"rov LAT", "ref LAT"} <= rows.keys():
        columns["lat"] = (rows["rov LAT"] - rows["ref LAT"]) * MILLISECONDS
    columns = {key: values[used] for key, values in columns.items()}
    return Part(path, Points(xyz[used], np.full(int(used.sum()), "eam"), columns), name, part, parts)


def join_parts(parts: Sequence[Part]) -> Points:
    """Return the points of all files of one map. Raises InputError where one is missing or comes twice."""
    first = min(parts, key=lambda one: one.part)
    there, wanted = sorted(one.part for one in parts), list(range(1, first.parts + 1))
    if there != wanted:
        raise InputError(
            f"{first.path}: is of map '{first.map_name}', which is in {first.parts} files: each must be once "
            f"there; there are {', '.join(map(str, there))}; name the folder of them all"
        )
    points, *more = (one.points for one in sorted(parts, key=lambda one: one.part))
    for some in more:
        points = joined(points, some)
    return points


def _read_rows(path: Path, text: str) -> dict[str, Array]:
    """Return the rows of numbers between the head and the electrograms, by name, with the stated count."""
    lines = text.splitlines()
    start = next((k for k, line in enumerate(lines) if FIRST.match(line)), len(lines))
    rows: dict[str, Array] = {}
    count = -1
    for at, line in enumerate(lines[start:], start + 1):
        if END.match(line):
            break
        comma = max(",;\t", key=line.count)
        name, *cells = (cell.strip() for cell in cells_of(line, comma, f"{path}: line {at}"))
        name = name.rstrip(":").strip()
        count = len(cells) - (not cells[-1:] or cells[-1] == "") if count < 0 else count
        if len([cell for cell in cells[count:] if cell]) or len(cells) < count:
            raise InputError(f"{path}: line {at}: '{name}' has {len(cells)} cells: the points are {count}")
        if name in (*PLACES, "pt number", "peak2peak", "rov LAT", "ref LAT", "utilized"):
            rows[name] = _row_numbers(cells[:count], f"{path}: line {at}, '{name}'", comma)
    else:
        raise InputError(
            f"{path}: line {len(lines)}: ends within the rows of points, without 'Seg data len'; the file is "
            "truncated: export it again"
        )
    if missing := [name for name in PLACES if name not in rows]:
        raise InputError(f"{path}: has no line '{missing[0]}:'; there are {', '.join(rows)}")
    if (stated := COUNT.search(text)) and int(stated[1]) != count:
        raise InputError(f"{path}: states {stated[1]} points and holds {count}; export it again")
    return rows


def row_names(path: Path, data: bytes) -> list[str]:
    """Return the names of the rows between the head and the electrograms."""
    lines = decode(data, path).splitlines()
    start = next((k for k, line in enumerate(lines) if FIRST.match(line)), len(lines))
    rows = list(takewhile(lambda line: not END.match(line), lines[start:]))
    return [re.split(r"[,;\t]", row)[0].strip(' "').rstrip(":").strip() for row in rows]


def _row_numbers(cells: Sequence[str], where: str, comma: str) -> Array:
    decimal = [cell.replace(",", ".") for cell in cells] if comma == ";" else cells
    values = []
    for at, cell in enumerate(decimal, 2):
        try:
            values.append(np.nan if not cell or is_missing(cell) else number(cell))
        except ValueError:
            raise InputError(f"{where}: cell {at} '{cell[:40]}' is not a number") from None
    return np.array(values, dtype=np.float64)
