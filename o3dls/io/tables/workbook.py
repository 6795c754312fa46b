"""Workbooks of spreadsheets: `.xlsx` by openpyxl, which is an extra; others are named."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Sequence
from datetime import date, time
from pathlib import Path
from typing import Any

from ...errors import InputError
from .cells import Cells, name_columns
from .headings import read_axes

SHEETS = "xl/workbook.xml"  # what a zip holds that is an .xlsx
OLD = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"  # begins files of Microsoft's older programs
LARGEST = 1 << 28  # bytes of its parts, unpacked
MOST_ROWS = 1_000_000


def knows(data: bytes) -> bool:
    return data[:4] == b"PK\x03\x04" or data[:8] == OLD


def read_workbook(path: Path, data: bytes, required: Sequence[str]) -> Cells:
    """Return the cells of the one sheet that has the required columns. Raises InputError where it is not an
    .xlsx, openpyxl is not installed, or no sheet or several have them.
    """
    _check_kind(path, data)
    try:
        import openpyxl
    except ImportError:
        raise InputError(
            f"{path}: is an Excel workbook, which needs openpyxl: pip install openpyxl; or save it as CSV"
        ) from None
    try:
        book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
        sheets = {sheet.title: list(_read_rows(path, sheet)) for sheet in book.worksheets}
    except InputError:
        raise
    except Exception as error:  # openpyxl raises errors of many kinds for damaged files
        raise InputError(f"{path}: is not a readable workbook: {error}") from None
    filled = [rows for rows in sheets.values() if rows]
    if len(filled) == 1:
        return _cells_of(path, filled[0], required)
    found = [cells for rows in filled if (cells := _table_or_none(path, rows, required)) is not None]
    if len(found) != 1:
        what = f"{len(found)} of its sheets have the columns {', '.join(required)}"
        raise InputError(f"{path}: {what}: there are {', '.join(sheets)}; save the one as CSV")
    return found[0]


def _check_kind(path: Path, data: bytes) -> None:
    """Raise InputError where the file is not an .xlsx of a size that can be meant."""
    if data[:8] == OLD:
        raise InputError(f"{path}: is a file of an older Excel or Word (.xls); save it as .xlsx or CSV")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            sizes = {info.filename: info.file_size for info in file.infolist()}
            mark = file.read("mimetype")[:80].decode("ascii", "replace") if "mimetype" in sizes else ""
    except (zipfile.BadZipFile, ValueError, RuntimeError, NotImplementedError, EOFError) as error:
        raise InputError(f"{path}: is a zip that cannot be read: {error}") from None
    if SHEETS not in sizes:
        kind = "an OpenDocument file (.ods)" if "opendocument" in mark else "a zip"
        raise InputError(f"{path}: is {kind}, no table; save it as CSV or .xlsx")
    if sum(sizes.values()) > LARGEST:
        raise InputError(f"{path}: unpacks to more than {LARGEST} bytes; save it as CSV")


def _read_rows(path: Path, sheet: Any) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows of a sheet that are not empty, with their numbers."""
    for at, row in enumerate(sheet.iter_rows(values_only=True), 1):
        if at > MOST_ROWS:
            raise InputError(f"{path}: sheet {sheet.title} has more than {MOST_ROWS} rows; save it as CSV")
        cells = [_format_value(value) for value in row]
        if any(cells):
            yield at, cells


def _format_value(value: Any) -> str:
    """Return a cell as CSV would have it."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    return value.isoformat() if isinstance(value, date | time) else str(value).strip()


def _table_or_none(path: Path, rows: list[tuple[int, list[str]]], required: Sequence[str]) -> Cells | None:
    """Return the table of a sheet; None where it has not the required columns."""
    try:
        cells = _cells_of(path, rows, required)
    except InputError:
        return None
    there = {name.lower() for name in read_axes(path, "", cells.header)[0]}
    return cells if set(required) <= there else None


def _cells_of(path: Path, rows: list[tuple[int, list[str]]], required: Sequence[str]) -> Cells:
    """Return the table of a sheet, as that of a text."""
    top = next((k for k, (_, cells) in enumerate(rows) if not cells[0].startswith("#")), len(rows))
    comments = [" ".join(filter(None, cells)) for _, cells in rows[:top]]
    if top == len(rows):
        raise InputError(f"{path}: has no header row: must name the columns {', '.join(required)}")
    (at, first), body = rows[top], rows[top:]
    width = max(k for k, cell in enumerate(first, 1) if cell)
    names = name_columns(first[:width], required, f"{path}: row {at}", path.suffix)
    header, below = (first[:width], body[1:]) if names is None else (names, body)
    return Cells(header, [cells for _, cells in below], at, [k for k, _ in below], comments, "row")
