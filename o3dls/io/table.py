"""Tables whose columns are known by name, `# key=value` comment lines above the header: read from text and
workbooks, written as CSV. A text that a spreadsheet would run as a formula has an apostrophe before it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..case import SPACES
from ..errors import Doubt, InputError
from .atomic import write_file
from .tables import workbook
from .tables.axes import axis_answers
from .tables.cells import FORMULA, split_text, without_index
from .tables.headings import read_axes
from .text import LARGEST_WHOLE, decode, is_missing, number, read_bytes

ZEROS = re.compile(r"^[-+]?0\d", re.MULTILINE)  # leading zeros, which a number would lose
LARGEST_TABLE = 1 << 26  # bytes: half a million points; a table takes ten times as much memory
MOST_COLUMNS = 1000  # an export has fifty, and a run adds two for each estimate


@dataclass(frozen=True)
class Table:
    """A table holds cells by column name, with the line of the file that each row stood on and the
    `key=value` notes of comment lines.

    The notes `space` and `units` are spelt as everywhere in o3dls, however the file spells them; `space` is a
    known one.
    """

    path: Path
    columns: Mapping[str, list[str]]
    lines: list[int]
    notes: Mapping[str, str]
    headings: Mapping[str, str] = field(default_factory=dict)  # of the columns, as the file has them
    row: str = "line"  # what a row is called in errors: of a cloud a point

    def __len__(self) -> int:
        return len(self.lines)

    def where(self, row: int, name: str) -> str:
        return f"{self.path}: {self.place(row)}, column '{name}'"

    def place(self, row: int) -> str:
        return f"{self.row} {self.lines[row]}"

    def numbers(self, name: str, *, missing: bool = False) -> Array:
        """Return a column as numbers (n,); empty cells and words such as `nan` and `NA` become NaN where
        `missing` is allowed. Raises InputError.
        """
        cells = self.columns[name]
        if (plain := _plain_numbers(cells, missing)) is not None:
            return plain
        return np.array(
            [self._read_number(row, name, cell, missing) for row, cell in enumerate(cells)], dtype=np.float64
        )

    def _read_number(self, row: int, name: str, cell: str, missing: bool) -> float:
        if missing and (not cell or is_missing(cell)):
            return np.nan
        try:
            value = number(cell)
        except ValueError:
            hint = (
                "has a decimal comma; write a decimal point"
                if re.fullmatch(r"[-+]?\d*,\d+", cell)
                else "is not a number"
            )
            hint += "; comments belong above the header" if "#" in cell else ""
            raise InputError(f"{self.where(row, name)}: '{cell}' {hint}") from None
        if not np.isfinite(value):
            raise InputError(f"{self.where(row, name)}: '{cell}' is not finite; every number must be")
        return value

    def values(self, name: str) -> NDArray[Any]:
        """Return a column as numbers where every cell is a number or empty, else as text; identifiers such as
        007 are text.
        """
        cells = self.columns[name]
        plain = _plain_numbers(cells, missing=True) if any(cells) else None
        if any(cells) and all(not cell or is_missing(cell) for cell in cells):
            nothing = {cell.lower() for cell in cells} <= {"", "nan"}
            return np.full(len(cells), np.nan) if nothing else np.array(cells, dtype=str)
        if (
            plain is not None
            and not ZEROS.search("\n".join(cells))
            and not (abs(plain) > LARGEST_WHOLE).any()
        ):
            return plain
        if any(cells) and all(_is_number(cell) for cell in cells):
            return self.numbers(name, missing=True)
        return np.array(cells, dtype=str)


def _is_number(cell: str) -> bool:
    """Return whether a cell is empty or a number that a float holds and that has no leading zeros, which it
    would lose.
    """
    try:
        value = number("nan" if not cell or is_missing(cell) else cell)
    except ValueError:
        return False
    return not ZEROS.match(cell) and not (re.fullmatch(r"[-+]?\d+", cell) and abs(value) > LARGEST_WHOLE)


def _plain_numbers(cells: Sequence[str], missing: bool) -> Array | None:
    """Return all cells as numbers at one go; None where one may be none, so that each is to be looked at."""
    filled = ["nan" if not cell or is_missing(cell) else cell for cell in cells] if missing else cells
    try:
        found = np.fromiter(map(float, filled), np.float64, len(cells))
    except ValueError:
        return None
    gaps = sum(cell.lower() == "nan" for cell in filled) if missing else 0
    alike = not any("_" in cell for cell in cells) and np.isfinite(found).sum() + gaps == len(cells)
    return found if alike else None


def read_table(path: str | Path, required: Iterable[str], aliases: Mapping[str, str] | None = None) -> Table:
    """Read the table in a file. Raises InputError naming file, line and column for anything that does not
    fit.
    """
    return table_of(read_bytes(Path(path), LARGEST_TABLE), Path(path), required, aliases)


def table_of(
    data: bytes,
    path: Path,
    required: Iterable[str],
    aliases: Mapping[str, str] | None = None,
    *,
    ask: bool = False,
) -> Table:
    """Return the table in the bytes of a file, which `path` names in errors; as `read_table`. ask: where a
    required column is missing, ask whether columns of numbers are the required ones (Doubt).
    """
    required = tuple(required)
    if workbook.knows(data):
        found = workbook.read_workbook(path, data, required)
    else:
        found = split_text(path, decode(data, path), required)
    top = f"{found.row} {found.top}"
    if len(found.header) > MOST_COLUMNS:
        raise InputError(f"{path}: {top}: names {len(found.header)} columns: at most {MOST_COLUMNS}")
    cells = without_index(path, found)
    header, units = read_axes(path, top, cells.header)
    named = _name_columns(header, {} if aliases is None else aliases)
    for name in required:
        if name not in named:
            said, listed = f"{path}: {top}: no column '{name}'", f"there are: {', '.join(header)[:200]}"
            raise Doubt(said, listed, axis_answers(required, header, cells.rows) if ask else ())
    _check_names(named, header, f"{path}: {top}")
    header = named
    columns = {name: [row[k] for row in cells.rows] for k, name in enumerate(header)}
    notes = _read_notes(path, cells.comments)
    if units is not None and notes.setdefault("units", units) != units:
        raise InputError(
            f"{path}: states units={notes['units']}, and its columns are in {units}; correct one"
        )
    headings = dict(zip(header, cells.header, strict=True))
    return Table(path, columns, cells.lines, notes, headings, cells.row)


def _read_notes(path: Path, comments: Sequence[str]) -> dict[str, str]:
    """Read the `key=value` pairs of comment lines. Raises InputError for a frame that is none."""
    notes = {key.lower(): value for key, value in re.findall(r"(\w+)=([^\s,;]+)", " ".join(comments))}
    spaces = {space.lower(): space for space in SPACES}
    if notes.get("space", "unknown").lower() not in spaces:
        raise InputError(f"{path}: states space={notes['space']}: must be one of {', '.join(SPACES)}")
    if "space" in notes:
        notes["space"] = spaces[notes["space"].lower()]
    return notes | ({"units": notes["units"].lower()} if "units" in notes else {})


def _name_columns(cells: Sequence[str], aliases: Mapping[str, str]) -> list[str]:
    """Return what the headings mean; one that is the name itself comes before others that mean it."""
    header = [aliases.get(cell.lower(), cell) for cell in cells]
    own = {name for name, cell in zip(header, cells, strict=True) if name == cell.lower()}
    return [
        cell if name in own and name != cell.lower() else name
        for name, cell in zip(header, cells, strict=True)
    ]


def _check_names(header: Sequence[str], cells: Sequence[str], where: str) -> None:
    """Raise InputError where a column has no name, or two have one."""
    for name in header:
        if not name or header.count(name) > 1:
            same = [cell for cell, one in zip(cells, header, strict=True) if one == name]
            fault = f"is meant by {' and '.join(same)}" if len(set(same)) > 1 else "appears twice"
            raise InputError(
                f"{where}: column name '{name}' {fault if name else 'is empty'}"
                + (f"; say --columns {name}=HEADING with the one that is right" if len(set(same)) > 1 else "")
            )


def write_table(
    path: str | Path, columns: Mapping[str, NDArray[Any]], notes: Mapping[str, str] | None = None
) -> None:
    """Write equal-length columns as CSV; numbers keep all their digits, NaN becomes an empty cell. Raises
    InputError for line breaks.
    """
    note = "# " + " ".join(f"{key}={value}" for key, value in notes.items()) + "\n" if notes else ""
    cells = (_format_column(values, f"{path}: column '{name}'") for name, values in columns.items())
    header = [_quote_cell(_mark_formula(name)) for name in columns]
    write_file(path, note + "".join(_join_cells(row) for row in (header, *zip(*cells, strict=True))))


def _join_cells(cells: Iterable[str]) -> str:
    return (",".join(cells) or '""') + "\n"  # an empty line would be no row


def _format_column(values: NDArray[Any], where: str) -> list[str]:
    if values.dtype.kind == "f":
        return ["" if value != value else repr(value) for value in values.tolist()]
    return [_quote_cell(_format_cell(value, where)) for value in values.tolist()]


def _quote_cell(cell: str) -> str:
    """Return a cell in quotes where a comma, a semicolon, a quote or a # at the beginning, as of a comment,
    would be misread.
    """
    return '"' + cell.replace('"', '""') + '"' if cell[:1] == "#" or re.search('[,;"]', cell) else cell


def _format_cell(value: Any, where: str) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else repr(value)
    text = str(value)
    if len(f"{text}.".splitlines()) > 1:
        raise InputError(f"{where}: {text!r} holds a line break, which a cell cannot; take it out first")
    return _mark_formula(text)


def _mark_formula(text: str) -> str:
    """Return the text so that a spreadsheet shows it and does not run it; a number, such as -1, is none that
    runs.
    """
    return f"'{text}" if FORMULA.match(text) and (is_missing(text) or not _is_number(text)) else text
