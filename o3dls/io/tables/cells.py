"""Tables of text become cells: what separates them, what is a decimal point, which columns are none."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...errors import InputError
from ..text import number

LONGEST_LINE = 1 << 16  # letters: fewer than the CSV reader takes of one cell
FORMULA = re.compile("'*[=+@-]")
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?")
AXES = ("x", "y", "z")
# Open3D's clouds of text, which have no header: places with normals, or with colours
BY_SUFFIX = {".xyzn": [[*AXES, "nx", "ny", "nz"]], ".xyzrgb": [[*AXES, "r", "g", "b"]]}


@dataclass(frozen=True)
class Cells:
    """A table of text has names of columns and rows, with the line of each, and comments above them.

    row: what errors call a line.
    """

    header: list[str]
    rows: list[list[str]]
    top: int
    lines: list[int]
    comments: list[str]
    row: str = "line"


def split_text(path: Path, text: str, required: Sequence[str]) -> Cells:
    """Return the cells of a table of text. Raises InputError where it has none, or a line is too long or
    holds part of a cell.
    """
    lines = [(at, line) for at, line in enumerate(text.splitlines(), 1) if line.strip()]
    for at, line in lines:
        if len(line) > LONGEST_LINE:
            raise InputError(f"{path}: line {at} has {len(line)} letters: must have at most {LONGEST_LINE}")
    top = next((k for k, (_, line) in enumerate(lines) if not line.lstrip().startswith("#")), len(lines))
    body = lines[top:]
    if not body:
        raise InputError(f"{path}: has no header line: must name the columns {', '.join(required)}")
    for at, line in body[1:]:
        if line.lstrip().startswith("#"):
            raise InputError(
                f"{path}: line {at} begins with #: comments belong above the header; a name that begins "
                "so stands in quotes"
            )
    delimiter = _find_delimiter([line for _, line in body])
    cells = _split_lines(path, [line for _, line in body], delimiter)
    if delimiter != ",":  # where commas separate, one of a decimal looks like one more cell
        cells = _with_points(cells)
        if all(len(row) == len(cells[0]) + 1 for row in cells[1:]) and _counts_up(cells[1:]):
            cells[0].insert(0, "")
    rows = [row for row, _ in body]
    comments = [line for _, line in lines[:top]]
    if (names := name_columns(cells[0], required, f"{path}: line {rows[0]}", path.suffix)) is not None:
        return Cells(names, cells, rows[0], rows, comments)
    return Cells(cells[0], cells[1:], rows[0], rows[1:], comments)


def _find_delimiter(lines: Sequence[str]) -> str:
    """Return what separates the cells: a semicolon or tab if the first line has one, else a comma, else
    blanks if all lines have as many words as the first, or one more, as R writes row numbers.
    """
    unquoted = re.sub('"[^"]*"', "", lines[0])
    if (found := next((d for d in ";\t," if d in unquoted), None)) is not None:
        return found
    width, *below = (len(line.split()) for line in lines)
    even = all(words == below[0] for words in below) and (not below or below[0] in (width, width + 1))
    return " " if even and width > 1 and '"' not in lines[0] else ","


def _split_lines(path: Path, lines: Sequence[str], delimiter: str) -> list[list[str]]:
    if delimiter == " ":
        return [line.split() for line in lines]
    found = [
        [_unmark_formula(cell.strip()) for cell in row] for row in csv.reader(lines, delimiter=delimiter)
    ]
    if len(found) != len(lines):
        raise InputError(f"{path}: a quoted cell runs over several lines; close the quotes on each line")
    return found


def _unmark_formula(cell: str) -> str:
    return cell[1:] if cell[:1] == "'" and FORMULA.match(cell) else cell


def _with_points(cells: list[list[str]]) -> list[list[str]]:
    """Return cells that no comma separates with decimal points for decimal commas. Where a number has a
    point, the commas are of thousands, or it is not clear what they are: they stay, and are no numbers.
    """
    if any(DECIMAL_POINT.fullmatch(cell) for row in cells for cell in row):
        return cells
    return [
        [cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in cells
    ]


def name_columns(first: Sequence[str], required: Sequence[str], where: str, suffix: str) -> list[str] | None:
    """Return the names of columns of a table that begins with numbers and not with names, where it is clear
    what they are: places, or names of places; None where it begins with names.

    Raises InputError where it is not clear.
    """
    axes = [axis for axis in AXES if axis in required]
    numeric = [_is_number(cell) for cell in first]
    if not axes or not any(numeric) or {cell.lower() for cell in first} & set(required):
        return None
    layouts = [["name", *axes], *([axes] if "name" not in required else [])]
    layouts += BY_SUFFIX.get(suffix.lower(), [])
    for names in layouts:
        if numeric == [name != "name" for name in names]:
            return names
    example = ",".join(required if "name" in required else [*required, "bipolar"])
    raise InputError(
        f"{where}: has numbers where the names of the columns should be: {', '.join(first)[:80]}; write a "
        f"line above it such as {example}"
    )


def _is_number(cell: str) -> bool:
    try:
        number(cell)
    except ValueError:
        return False
    return True


def without_index(path: Path, cells: Cells) -> Cells:
    """Return the table without columns that hold nothing: those without name and values, as spreadsheets
    leave behind, and the row numbers that pandas and R write first. Raises InputError where a row has more or
    fewer cells than there are names.
    """
    header, rows = list(cells.header), [list(row) for row in cells.rows]
    for at, row in zip(cells.lines, rows, strict=True):
        while len(row) > len(header) and not row[-1]:
            row.pop()
        while len(header) > len(row) and not any(header[len(row) :]):
            row.append("")
        if len(row) != len(header):
            hint = "; decimal commas? write decimal points" if len(row) > len(header) else ""
            raise InputError(
                f"{path}: {cells.row} {at} has {len(row)} cells, the header has {len(header)}{hint}"
            )
    kept = [k for k, name in enumerate(header) if name or any(row[k] for row in rows)]
    if kept and kept[0] == 0 and not header[0] and all(re.fullmatch(r"\d+", row[0]) for row in rows):
        kept = kept[1:]
    if len(kept) == len(header):
        return replace(cells, header=header, rows=rows)
    return replace(cells, header=[header[k] for k in kept], rows=[[row[k] for k in kept] for row in rows])


def _counts_up(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether rows begin with the whole numbers from 0 or 1 on."""
    first = [row[0].strip('"') for row in rows]
    return any(first == [str(k) for k in range(start, start + len(rows))] for start in (0, 1))
