"""PLY, ascii and binary: geometry, per-vertex fields, and frame and units in comment lines."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry import Array, Ints, Surface
from .surface_file import NOTICE, SurfaceFile, flatten_fields, gather_fields, triangulate
from .text import number_rows

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


@dataclass
class Element:
    """One `element` of the header: its rows and properties (name, type, count type or None for scalars)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)


def read(path: Path, data: bytes) -> SurfaceFile:
    """Decode a PLY file. Raises InputError naming the file and what is missing or wrong."""
    header, body = _split(path, data)
    order, elements, notes = _parse_header(path, header)
    rows = _ascii_rows if order == "" else _binary_rows
    tables: dict[str, dict[str, Any]] = {}
    for element in elements:
        tables[element.name], body = rows(path, element, body, order)
        if element.name == "face":
            break
    vertices, fields = _vertices(path, tables.get("vertex", {}))
    polygons = next((tables["face"][k] for k in ("vertex_indices", "vertex_index") if k in tables.get("face", {})), None)
    if polygons is None:
        raise InputError(f"{path}: has no faces (element 'face' with a list 'vertex_indices'); a surface needs triangles")
    return SurfaceFile.of(path, vertices, triangulate(polygons), fields, space=notes.get("SPACE"), units=notes.get("UNITS"))


def _split(path: Path, data: bytes) -> tuple[list[str], Any]:
    end = re.search(rb"^end_header[ \t]*\r?\n", data[:1_000_000], re.MULTILINE)
    if end is None:
        raise InputError(f"{path}: PLY header has no line 'end_header'; the file is truncated or not a PLY")
    return data[: end.start()].decode("utf-8", errors="replace").splitlines(), memoryview(data)[end.end() :]


def _parse_header(path: Path, lines: list[str]) -> tuple[str, list[Element], dict[str, str]]:
    order, elements, notes = None, list[Element](), dict[str, str]()
    for number, line in enumerate(lines, 1):
        match line.split():
            case ["format", kind, _] if kind in ORDERS:
                order = ORDERS[kind]
            case ["element", name, count] if count.isdigit():
                elements.append(Element(name, int(count)))
            case ["property", "list", count_type, kind, name] if elements and {count_type, kind} <= TYPES.keys():
                elements[-1].properties.append((name, TYPES[kind], TYPES[count_type]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, TYPES[kind], None))
            case ["comment" | "obj_info", *words]:
                notes |= dict(word.split("=", 1) for word in words if "=" in word)
            case ["ply"] | []:
                pass
            case _:
                raise InputError(f"{path}: line {number}: '{line[:80]}' is no PLY header line")
    if order is None:
        raise InputError(f"{path}: PLY header has no 'format' line")
    return order, elements, notes


def _truncated(path: Path, element: Element, found: int) -> InputError:
    return InputError(f"{path}: PLY declares {element.count} rows of '{element.name}' and holds {found}: the file is truncated")


def _binary_rows(path: Path, element: Element, body: Any, order: str) -> tuple[dict[str, Any], Any]:
    """Columns of a binary element; lists must have one length, which the first row tells, else rows are read one by one."""
    lengths = _first_lengths(element, body, order)
    dtype = np.dtype([d for prop in element.properties for d in _fields(prop, lengths.get(prop[0], 0), order)])
    size = dtype.itemsize * element.count
    if size > len(body) and not lengths:
        raise _truncated(path, element, len(body) // max(dtype.itemsize, 1))
    if size <= len(body):
        rows = np.frombuffer(body, dtype, element.count)
        if all((rows[f"{name} count"] == n).all() for name, n in lengths.items()):
            return {name: rows[name] for name, _, _ in element.properties}, body[size:]
    return _ragged_rows(path, element, body, order)


def _fields(prop: tuple[str, str, str | None], length: int, order: str) -> list[Any]:
    name, kind, count_type = prop
    if count_type is None:
        return [(name, order + kind)]
    return [(f"{name} count", order + count_type), (name, order + kind, (length,))]


def _first_lengths(element: Element, body: Any, order: str) -> dict[str, int]:
    """Length of every list in the first row; 0 where the body is too short to tell."""
    lengths, offset = dict[str, int](), 0
    for name, kind, count_type in element.properties:
        n = 1
        if count_type is not None:
            count = np.dtype(order + count_type)
            n = int(np.frombuffer(body[offset : offset + count.itemsize], count)[0]) if offset + count.itemsize <= len(body) else 0
            n = max(n, 0) if element.count else 0
            lengths[name] = n
            offset += count.itemsize
        offset += n * np.dtype(kind).itemsize
    return lengths if all(n * 8 <= len(body) + 8 for n in lengths.values()) else dict.fromkeys(lengths, 0)


def _ragged_rows(path: Path, element: Element, body: Any, order: str) -> tuple[dict[str, Any], Any]:
    """Columns of a binary element whose lists differ in length."""
    columns: dict[str, list[Any]] = {name: [] for name, _, _ in element.properties}
    offset = 0
    for row in range(element.count):
        for name, kind, count_type in element.properties:
            n = 1
            if count_type is not None:
                count = np.dtype(order + count_type)
                if offset + count.itemsize > len(body):
                    raise _truncated(path, element, row)
                n = int(np.frombuffer(body, count, 1, offset)[0])
                offset += count.itemsize
            width = n * np.dtype(kind).itemsize
            if n < 0 or offset + width > len(body):
                raise _truncated(path, element, row)
            values = np.frombuffer(body, order + kind, n, offset)
            columns[name].append(values if count_type else values[0])
            offset += width
    return columns, body[offset:]


def _ascii_rows(path: Path, element: Element, body: Any, order: str) -> tuple[dict[str, Any], Any]:
    if not isinstance(body, list):
        body = [line for line in bytes(body).decode("utf-8", errors="replace").splitlines() if line.strip()]
    lines: list[str] = body
    if len(lines) < element.count:
        raise _truncated(path, element, len(lines))
    mine, rest = lines[: element.count], lines[element.count :]
    if all(count_type is None for _, _, count_type in element.properties):
        table = number_rows(mine, len(element.properties), path, 1, f"row of '{element.name}'")
        return {name: table[:, k] for k, (name, _, _) in enumerate(element.properties)}, rest
    return _ascii_lists(path, element, mine), rest


def _ascii_lists(path: Path, element: Element, lines: list[str]) -> dict[str, Any]:
    """Columns of an ascii element with lists; rows of equal length are parsed at once."""
    name = element.properties[0][0]
    if len(element.properties) == 1 and lines:
        width = len(lines[0].split())
        if all(len(line.split()) == width for line in lines):
            table = number_rows(lines, width, path, 1, f"row of '{element.name}'")
            if (table[:, 0] == width - 1).all():
                return {name: table[:, 1:]}
    columns: dict[str, list[Any]] = {name: [] for name, _, _ in element.properties}
    for row, line in enumerate(lines):
        words = number_rows([line], len(line.split()), path, row + 1, f"row of '{element.name}'")[0]
        for name, _, count_type in element.properties:
            n = 1 if count_type is None else int(words[0]) if len(words) else -1
            words = words if count_type is None else words[1:]
            if n < 0 or n > len(words):
                raise InputError(f"{path}: row {row} of '{element.name}' is too short: '{line[:80]}'")
            columns[name].append(words[:n] if count_type else words[0])
            words = words[n:]
    return columns


def _vertices(path: Path, columns: dict[str, Any]) -> tuple[Array, dict[str, Array]]:
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"{path}: PLY vertices have no property '{missing[0]}'")
    fields = {name: np.asarray(v, dtype=np.float64) for name, v in columns.items() if name not in ("x", "y", "z", "nx", "ny", "nz")}
    return np.column_stack([np.asarray(columns[axis], dtype=np.float64) for axis in "xyz"]), gather_fields(fields)


def write(file: SurfaceFile) -> bytes:
    """Encode as binary little-endian PLY: double coordinates and fields, frame and units in comments."""
    surface = file.surface
    scalars = flatten_fields(surface.fields)
    names = ["x", "y", "z", *scalars]
    vertices = np.column_stack([surface.vertices, *scalars.values()]).astype("<f8")
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment SPACE={file.space}",
        f"comment UNITS={file.units}",
        f"comment {NOTICE}",
        f"element vertex {len(vertices)}",
        *(f"property double {name}" for name in names),
        f"element face {len(surface.faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(header).encode() + vertices.tobytes() + _face_rows(surface).tobytes()


def _face_rows(surface: Surface) -> NDArray[Any]:
    faces: Ints = surface.faces
    rows = np.empty(len(faces), dtype=[("n", "u1"), ("corners", "<i4", (3,))])
    rows["n"], rows["corners"] = 3, faces
    return rows
