"""Legacy VTK files, versions 1.0 to 5.1, ascii and binary: surfaces of POLYDATA and UNSTRUCTURED_GRID with
their point and cell data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Ints
from ..text import typed
from .cells import POLYGON, STRIP, TEXT, Cells, surface_of
from .cloud import Cloud
from .surface_file import NOTICE, SurfaceFile
from .vtk_cursor import TYPES, Cursor

Fields = dict[str, NDArray[Any]]
# sections of cells in the order of their data, with VTK's number of their kind; for CELLS it follows
KINDS = {"VERTICES": 2, "LINES": 4, "POLYGONS": POLYGON, "TRIANGLE_STRIPS": STRIP, "CELLS": 0}
WIDTHS = {"NORMALS": 3, "VECTORS": 3, "TENSORS": 9, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}


def knows(data: bytes) -> bool:
    return data.lstrip()[:18].lower() == b"# vtk datafile ver"


def read(path: Path, data: bytes) -> SurfaceFile:
    """Decode a legacy VTK file; polygons and strips become triangles, solids their boundary, cell data are
    carried to the points. Raises InputError naming the place.
    """
    vertices, cells, on_points, on_cells, title = parse(path, data)
    file = surface_of(path, vertices, cells, on_points, on_cells, title)
    return replace(file, metadata={"title": title})


def read_cloud(path: Path, data: bytes) -> Cloud:
    """Decode the points of a legacy VTK file with their values. Raises InputError."""
    vertices, cells, on_points, _, title = parse(path, data)
    return Cloud.stated(vertices, on_points, title, cells.faces)


def parse(path: Path, data: bytes) -> tuple[Array, Cells, Fields, Fields, str]:
    """Return points, cells, values of both, and the title."""
    cursor = Cursor(path, data)
    cursor.line()
    title = cursor.line()
    cursor.binary = cursor.choice("ASCII", "BINARY") == "BINARY"
    cursor.choice("DATASET POLYDATA", "DATASET UNSTRUCTURED_GRID")
    vertices = np.zeros((0, 3))
    parts: dict[str, Cells] = {}
    data_of: dict[str, Fields] = {"POINT_DATA": {}, "CELL_DATA": {}, "": {}}
    where, rows = "", 0
    while words := cursor.words():
        match [words[0].upper(), *words[1:]]:
            case ["POINTS", n, kind]:
                vertices = cursor.numbers(cursor.count(n) * 3, kind).reshape(-1, 3)
            case [what, n, size] if what in KINDS:
                if what in parts:
                    raise cursor.error(f"{what} appear twice")
                parts[what] = _read_cells(cursor, cursor.count(n), cursor.count(size), KINDS[what])
            case ["CELL_TYPES", n]:
                types = cursor.integers(cursor.count(n), "int")
                parts["CELLS"] = _set_types(cursor, parts, types)
            case ["POINT_DATA" | "CELL_DATA" as where, n]:
                rows = cursor.count(n)
            case ["METADATA"]:
                cursor.skip_block()
            case _:
                found = _read_attribute(cursor, words, rows)
                there = len(vertices) if where == "POINT_DATA" else sum(map(len, parts.values()))
                data_of[where] |= _check_lengths(cursor, found, where, there)
    cells = Cells.joined([parts[what] for what in KINDS if what in parts])
    if (cells.types == KINDS["CELLS"]).any():
        raise cursor.error("the kinds of the CELLS are not stated: CELL_TYPES must follow them")
    return vertices, cells, data_of["POINT_DATA"], data_of["CELL_DATA"], title


def _read_cells(cursor: Cursor, n: int, size: int, kind: int) -> Cells:
    """Read cells of one kind: rows `k i j ...` up to version 4.2, offsets and connectivity from 5.0 on."""
    place = cursor.at
    words = cursor.words()
    if words[:1] == ["OFFSETS"]:
        offsets = cursor.integers(n, words[-1])
        corners = cursor.integers(size, cursor.expect("CONNECTIVITY")[-1])
        sizes = np.diff(offsets)
        if len(offsets) and ((sizes < 0).any() or offsets[0] != 0 or offsets[-1] != len(corners)):
            raise cursor.error("cell offsets do not fit their connectivity")
        return Cells.of(sizes, corners, kind)
    cursor.at = place
    flat = cursor.integers(size, "int")
    if size == 4 * n and (flat[::4] == 3).all():  # a short cut for nearly every file
        return Cells.of(np.full(n, 3), flat.reshape(n, 4)[:, 1:].ravel(), kind)
    return Cells.of(*_unroll_rows(cursor, flat, n), kind)


def _unroll_rows(cursor: Cursor, flat: Ints, n: int) -> tuple[Ints, Ints]:
    """Return the lengths and corners of rows `k i j ...`."""
    starts = np.zeros(n + 1, dtype=np.int64)
    for row in range(n):
        if starts[row] >= len(flat) or flat[starts[row]] < 0:
            raise cursor.error(f"cell {row} of {n} is missing: the counts do not fit the cells")
        starts[row + 1] = starts[row] + flat[starts[row]] + 1
    if starts[-1] != len(flat):
        raise cursor.error(f"{n} cells take {starts[-1]} numbers: {len(flat)} are declared")
    return np.diff(starts) - 1, np.delete(flat, starts[:-1])


def _set_types(cursor: Cursor, parts: Mapping[str, Cells], types: Ints) -> Cells:
    """Return the cells of an unstructured grid with the kinds that the file states behind them."""
    cells = parts.get("CELLS", Cells.joined([]))
    if len(types) != len(cells):
        raise cursor.error(f"there are {len(types)} CELL_TYPES and {len(cells)} CELLS")
    return replace(cells, types=types)


def _check_lengths(cursor: Cursor, found: Fields, where: str, n: int) -> Fields:
    """Return the data unchanged. Raises InputError where an array is longer or shorter than the points or
    cells.
    """
    what = where.replace("_", " ").lower()
    for name, values in found.items():
        if where and len(values) != n:
            raise cursor.error(f"{what} '{name}' have {len(values)} rows: there are {n} {what.split()[0]}s")
    return found


def _read_attribute(cursor: Cursor, words: list[str], n: int) -> Fields:
    """Read the arrays that one attribute keyword brings; tables and texture coordinates are read over."""
    match [words[0].upper(), *words[1:]]:
        case ["SCALARS", name, kind, *rest]:
            width = cursor.count(rest[0]) if rest else 1
            place = cursor.at
            if cursor.words()[:1] != ["LOOKUP_TABLE"]:
                cursor.at = place
            return _as_field(name, cursor.numbers(n * width, kind), width, kind)
        case ["NORMALS" | "VECTORS" | "TENSORS" | "GLOBAL_IDS" | "PEDIGREE_IDS" as what, name, kind]:
            return (
                _as_field(name, cursor.numbers(n * WIDTHS[what], kind), WIDTHS[what], kind)
                if what != "NORMALS"
                else _skip_numbers(cursor, n * 3, kind)
            )
        case ["TEXTURE_COORDINATES", _, width, kind]:
            return _skip_numbers(cursor, n * cursor.count(width), kind)
        case ["COLOR_SCALARS", name, width]:
            values = cursor.numbers(n * cursor.count(width), "unsigned_char" if cursor.binary else "float")
            # ascii colours are within 0 and 1
            values = values if cursor.binary else np.rint(255.0 * values)
            return _as_field(name, values, cursor.count(width), "unsigned_char")
        case ["LOOKUP_TABLE", _, size]:
            return _skip_numbers(
                cursor, 4 * cursor.count(size), "unsigned_char" if cursor.binary else "float"
            )
        case ["FIELD", _, arrays]:
            return _read_field_arrays(cursor, cursor.count(arrays))
    raise cursor.error(f"'{' '.join(words)[:60]}' is not a known VTK keyword")


def _skip_numbers(cursor: Cursor, count: int, kind: str) -> Fields:
    cursor.numbers(count, kind)
    return {}


def _as_field(name: str, values: Array, width: int, kind: str) -> Fields:
    numbers = typed(values, TYPES[kind])
    return {unquote(name): numbers if width == 1 else numbers.reshape(-1, max(width, 1))}


def _read_field_arrays(cursor: Cursor, arrays: int) -> Fields:
    found: Fields = {}
    while arrays > 0:
        words = cursor.words()
        if words[:1] == ["METADATA"]:
            cursor.skip_block()
            continue
        if len(words) != 4:
            raise cursor.error(f"'{' '.join(words)[:60]}' must be a field's name, components, rows and type")
        name = words[0]
        width = cursor.count(words[1])
        rows = cursor.count(words[2])
        kind = words[3]
        if kind == "string":
            cursor.skip_strings(width * rows)
            found[unquote(name)] = np.zeros(rows, dtype=TEXT)
        else:
            found |= _as_field(name, cursor.numbers(width * rows, kind), width, kind)
        arrays -= 1
    return found


def write(file: SurfaceFile) -> bytes:
    """Encode as version 4.2, binary: what VTK 5 to 9, Slicer and ParaView all read. 2D outlines become lines
    at z = 0.
    """
    surface = file.surface
    n, d = surface.vertices.shape
    xyz = np.column_stack([surface.vertices, np.zeros((n, 3 - d))])
    cells = np.column_stack([np.full(len(surface.faces), d), surface.faces])
    title = f"{NOTICE} SPACE={file.space} UNITS={file.units}"
    head = f"# vtk DataFile Version 4.2\n{title}\nBINARY\nDATASET POLYDATA\nPOINTS {n} double\n"
    parts = [head.encode(), xyz.astype(">f8").tobytes()]
    parts += [
        f"\n{'POLYGONS' if d == 3 else 'LINES'} {len(cells)} {cells.size}\n".encode(),
        cells.astype(">i4").tobytes(),
    ]
    if surface.fields:
        parts.append(f"\nPOINT_DATA {n}\nFIELD FieldData {len(surface.fields)}\n".encode())
    for name, values in surface.fields.items():
        width = 1 if values.ndim == 1 else values.shape[1]
        parts += [
            f"{quote(name)} {width} {n} double\n".encode(),
            np.asarray(values).astype(">f8").tobytes(),
            b"\n",
        ]
    return b"".join(parts) + b"\n"
