"""PLY, ascii and binary: geometry, per-vertex fields, and frame and units in comment lines."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ..text import is_count
from .ply_rows import Columns, Element, Property, ascii_rows, binary_rows, truncated
from .surface_file import NOTICE, SurfaceFile, check_end, flatten_fields, gather_fields
from .triangulation import triangulate

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
GEOMETRY = ("x", "y", "z", "nx", "ny", "nz")
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


def knows(data: bytes) -> bool:
    return data[:4] in (b"ply\n", b"ply\r")


def read(path: Path, data: bytes) -> SurfaceFile:
    """Decode a PLY file. Raises InputError naming the file and what is missing or wrong."""
    end = re.search(rb"^end_header[ \t]*\r?\n", data[:1_000_000], re.MULTILINE)
    if end is None:
        raise InputError(f"{path}: PLY header has no line 'end_header'; the file is truncated or not a PLY")
    header = data[: end.start()].decode("utf-8", errors="replace").splitlines()
    order, elements = _parse_header(path, header)
    if any(element.name == "tristrips" and element.rows for element in elements):
        raise InputError(
            f"{path}: holds triangle strips (element 'tristrips'), which are not read; save it with triangles"
        )
    comments = "\n".join(line for line in header if line.startswith("comment"))
    if not order:
        check_end(path, data, comments)
    body = memoryview(data)[end.end() :]
    tables = (
        _binary_tables(path, elements, body, order)
        if order
        else _ascii_tables(path, elements, body, len(header) + 2)
    )
    vertices = _vertices(path, tables.get("vertex", {}))
    fields, notes = _fields(tables["vertex"], "vertices")
    faces = tables.get("face", {})
    lists = {
        element.name: [prop.name for prop in element.properties if prop.count] for element in elements
    }.get("face", [])
    corners = next((name for name in ("vertex_indices", "vertex_index") if name in lists), None)
    if corners is None:
        raise InputError(
            f"{path}: has no faces (element 'face' with a list 'vertex_indices'); a surface needs triangles"
        )
    triangles, _ = triangulate(vertices, *_blocks(faces[corners]))
    return SurfaceFile.of(path, vertices, triangles, fields, header=comments, notes=notes)


def _parse_header(path: Path, lines: list[str]) -> tuple[str, list[Element]]:
    order = None
    elements = list[Element]()
    for number, line in enumerate(lines, 1):
        match line.split():
            case ["format", kind, _] if kind in ORDERS:
                order = ORDERS[kind]
            case ["element", name, count] if is_count(count):
                elements.append(Element(name, int(count)))
            case ["property", "list", count, kind, name] if elements and {count, kind} <= TYPES.keys():
                elements[-1].properties.append(Property(name, TYPES[kind], TYPES[count]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(Property(name, TYPES[kind]))
            case ["ply"] | ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise InputError(f"{path}: line {number}: '{line[:80]}' is no PLY header line")
    if order is None:
        raise InputError(f"{path}: PLY header has no 'format' line")
    for element in elements:
        names = [prop.name for prop in element.properties]
        if len(set(names)) < len(names) or not names:
            raise InputError(f"{path}: PLY element '{element.name}' has no property, or one name twice")
    return order, elements


def _binary_tables(path: Path, elements: list[Element], body: memoryview, order: str) -> dict[str, Columns]:
    tables = {}
    for element in elements:
        tables[element.name], body = binary_rows(path, element, body, order)
    return tables


def _ascii_tables(path: Path, elements: list[Element], body: memoryview, first: int) -> dict[str, Columns]:
    text = bytes(body).decode("utf-8", errors="replace")
    lines = [(k, line) for k, line in enumerate(text.splitlines(), first) if line.strip()]
    tables = {}
    for element in elements:
        if len(lines) < element.rows:
            raise truncated(path, element, len(lines))
        tables[element.name] = ascii_rows(path, element, lines[: element.rows])
        lines = lines[element.rows :]
    return tables


def _blocks(polygons: Any) -> list[Any]:
    """Polygons of equal size together, (k, n) each."""
    if not isinstance(polygons, list):
        return [polygons]
    return [np.array([p for p in polygons if len(p) == n]) for n in sorted(set(map(len, polygons)))]


def _vertices(path: Path, columns: Columns) -> Array:
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"{path}: PLY vertices have no property '{missing[0]}'")
    return np.column_stack([np.asarray(columns[axis], dtype=np.float64) for axis in "xyz"])


def _fields(columns: Columns, of: str) -> tuple[dict[str, Array], list[str]]:
    """Columns other than geometry, and a sentence for each that has no place: lists that differ in length."""
    uneven = [name for name, values in columns.items() if isinstance(values, list)]
    fields = {
        name: np.asarray(values, dtype=np.float64)
        for name, values in columns.items()
        if name not in (*GEOMETRY, *uneven) and np.size(values)  # lists may all be empty
    }
    return gather_fields(fields), [
        f"list property '{name}' of the {of} is left out: its lists differ in length" for name in uneven
    ]


def write(file: SurfaceFile) -> bytes:
    """Encode as binary little-endian PLY: double coordinates and fields, frame and units in comments."""
    surface = file.surface
    scalars = flatten_fields(surface.fields, GEOMETRY)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment SPACE={file.space}",
        f"comment UNITS={file.units}",
        f"comment {NOTICE}",
        f"element vertex {len(surface.vertices)}",
        *(f"property double {name}" for name in ("x", "y", "z", *scalars)),
        f"element face {len(surface.faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    vertices = np.column_stack([surface.vertices, *scalars.values()]).astype("<f8")
    faces = np.empty(len(surface.faces), dtype=[("n", "u1"), ("corners", "<i4", (3,))])
    faces["n"] = 3
    faces["corners"] = surface.faces
    return "\n".join(header).encode() + vertices.tobytes() + faces.tobytes()
