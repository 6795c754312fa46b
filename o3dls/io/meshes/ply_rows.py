"""The rows of PLY elements, ascii and binary: whole tables where every list has the length of the first
row's, else row by row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..text import number_rows

Columns = dict[str, Any]  # (n,) for scalars, (n, k) for lists of one length, else a list of arrays


@dataclass(frozen=True)
class Property:
    """A property has a name, a numpy type, and the type of the count that stands before a list."""

    name: str
    kind: str
    count: str | None = None


@dataclass
class Element:
    """This is one `element` of the header of a PLY file."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)


def truncated(path: Path, element: Element, found: int) -> InputError:
    return InputError(
        f"{path}: PLY declares {element.rows} rows of '{element.name}' and holds {found}: the file is "
        "truncated"
    )


def whole(count: Any) -> int:
    """Return a count as it stands in a file; -1, which no list has, where it is not a whole number."""
    return int(count) if np.isfinite(count) and count == np.floor(count) and abs(count) < 1e12 else -1


def walk(
    element: Element, take: Callable[[str, int], NDArray[Any]]
) -> Iterator[tuple[Property, NDArray[Any]]]:
    """Yield every property of one row with its values; `take(kind, n)` hands out the next n values."""
    for prop in element.properties:
        n = whole(take(prop.count, 1)[0]) if prop.count else 1
        yield prop, take(prop.kind, n)


def ascii_rows(path: Path, element: Element, lines: Sequence[tuple[int, str]]) -> Columns:
    """Return the columns from numbered lines, as many as the element has rows. Raises InputError naming the
    line.
    """
    at = [k for k, _ in lines]
    text = [line for _, line in lines]
    what = f"row of '{element.name}'"
    scalars = all(prop.count is None for prop in element.properties)
    if scalars or len({len(line.split()) for line in text}) == 1:
        width = len(element.properties) if scalars else len(text[0].split())
        table = number_rows(text, width, path, at, what)
        if (columns := _split_columns(element, table)) is not None:
            return columns
    cells = (number_rows([line], len(line.split()), path, [k], what)[0] for k, line in lines)
    rows = [
        dict(_name_cells(element, row, f"{path}: line {k}")) for (k, _), row in zip(lines, cells, strict=True)
    ]
    return _join_rows(element, {prop.name: [row[prop.name] for row in rows] for prop in element.properties})


def _join_rows(element: Element, rows: Mapping[str, list[Any]]) -> Columns:
    """Return columns out of rows: arrays but for lists that differ in length."""
    uneven = {
        prop.name for prop in element.properties if prop.count and len(set(map(len, rows[prop.name]))) != 1
    }
    return {name: values if name in uneven else np.array(values) for name, values in rows.items()}


def _name_cells(element: Element, cells: NDArray[Any], where: str) -> Iterator[tuple[str, Any]]:
    rest = cells

    def take(kind: str, n: int) -> NDArray[Any]:
        nonlocal rest
        if not 0 <= n <= len(rest):
            raise InputError(f"{where}: '{element.name}' has {len(cells)} numbers, fewer than it declares")
        taken = rest[:n]
        rest = rest[n:]
        return taken

    for prop, values in walk(element, take):
        yield prop.name, values if prop.count else values[0]


def _split_columns(element: Element, table: NDArray[Any]) -> Columns | None:
    """Return columns of a table whose lists all have the length of the first row's; None where they differ or
    do not fill it.
    """
    columns = Columns()
    k = 0
    for prop in element.properties:
        if prop.count:
            n = whole(table[0, k]) if len(table) and k < table.shape[1] else 0
            if k >= table.shape[1] or n < 0 or (table[:, k] != n).any():
                return None
            columns[prop.name] = table[:, k + 1 : k + 1 + n]
            k = k + 1 + n
        else:
            columns[prop.name] = table[:, min(k, table.shape[1] - 1)]
            k = k + 1
    return columns if k == table.shape[1] else None


def binary_rows(path: Path, element: Element, body: memoryview, order: str) -> tuple[Columns, memoryview]:
    """Return columns of a binary element (order '<' or '>') and what follows it. Raises InputError where the
    body is too short.
    """
    lengths = _first_lengths(element, body, order)
    dtype = np.dtype(
        [d for prop in element.properties for d in _field_types(prop, lengths.get(prop.name, 0), order)]
    )
    size = dtype.itemsize * element.rows
    if size <= len(body):
        rows = np.frombuffer(body, dtype, element.rows)
        if all((rows[f"{name} count"] == n).all() for name, n in lengths.items()):
            return {prop.name: rows[prop.name] for prop in element.properties}, body[size:]
    elif not lengths:
        raise truncated(path, element, len(body) // max(dtype.itemsize, 1))
    return _read_row_by_row(path, element, body, order)


def _field_types(prop: Property, length: int, order: str) -> list[Any]:
    if prop.count is None:
        return [(prop.name, order + prop.kind)]
    return [(f"{prop.name} count", order + prop.count), (prop.name, order + prop.kind, (length,))]


def _first_lengths(element: Element, body: memoryview, order: str) -> Mapping[str, int]:
    """Return the length of every list in the first row; 0 where the body is too short to tell."""
    lengths = {prop.name: 0 for prop in element.properties if prop.count}
    take = Taker(body, order)
    with suppress(EOFError):
        lengths |= (
            {prop.name: len(values) for prop, values in walk(element, take) if prop.count}
            if element.rows
            else {}
        )
    return lengths


@dataclass
class Taker:
    """A taker hands out the next values of a binary body. Raises EOFError at its end."""

    body: memoryview
    order: str
    at: int = 0

    def __call__(self, kind: str, n: int) -> NDArray[Any]:
        dtype = np.dtype(self.order + kind)
        end = self.at + n * dtype.itemsize
        if n < 0 or end > len(self.body):
            raise EOFError
        values = np.frombuffer(self.body, dtype, n, self.at) if n else np.zeros(0, dtype)
        self.at = end
        return values


def _read_row_by_row(
    path: Path, element: Element, body: memoryview, order: str
) -> tuple[Columns, memoryview]:
    """Read columns of a binary element whose lists differ in length."""
    columns: dict[str, list[Any]] = {prop.name: [] for prop in element.properties}
    take = Taker(body, order)
    for row in range(element.rows):
        try:
            for prop, values in walk(element, take):
                columns[prop.name].append(values if prop.count else values[0])
        except EOFError:
            raise truncated(path, element, row) from None
    return _join_rows(element, columns), body[take.at :]
