"""PLY, ascii and binary: geometry, per-vertex fields, and frame and units in comment lines."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Ints
from ...errors import InputError
from ..text import is_count, typed
from .cloud import Cloud
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
CORNERS = ("vertex_indices", "vertex_index")
GEOMETRY = ("x", "y", "z", "nx", "ny", "nz")
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


def knows(data: bytes) -> bool:
    return data[:4] in (b"ply\n", b"ply\r")


def read(path: Path, data: bytes) -> SurfaceFile:
    """Decode a PLY file. Raises InputError naming the file and what is missing or wrong."""
    named, tables, comments = _read_tables(path, data)
    vertices = _stack_vertices(path, tables.get("vertex", {}))
    lists = [prop.name for prop in named["face"].properties if prop.count] if "face" in named else []
    corners = next((name for name in CORNERS if name in lists), None)
    if corners is None:
        raise InputError(
            f"{path}: has no faces (element 'face' with a list 'vertex_indices'); a surface needs triangles"
        )
    blocks, rows = _group_by_size(tables["face"][corners])
    triangles, owner = triangulate(vertices, *blocks)
    fields, notes = _gather_columns(named["vertex"], tables["vertex"])
    values, more = _gather_columns(named["face"], tables["face"])
    cells = {name: array[rows[owner]] for name, array in values.items()}
    file = SurfaceFile.of(path, vertices, triangles, fields, cells=cells, header=comments)
    return file.noted([*notes, *more])


def read_cloud(path: Path, data: bytes) -> Cloud:
    """Decode the vertices of a PLY file with their values. Raises InputError."""
    named, tables, comments = _read_tables(path, data)
    vertices = _stack_vertices(path, tables.get("vertex", {}))
    faces = named["face"].rows if "face" in named else 0
    return Cloud.stated(vertices, _gather_columns(named["vertex"], tables["vertex"])[0], comments, faces)


def _read_tables(path: Path, data: bytes) -> tuple[dict[str, Element], dict[str, Columns], str]:
    """Return the elements by name, their tables, and the comments."""
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
    return {element.name: element for element in elements}, tables, comments


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
                raise InputError(f"{path}: line {number}: '{line[:80]}' is not a PLY header line")
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
    if bytes(body).strip(b"\0\r\n"):
        raise _too_few_stated(path, f"{len(body)} bytes")
    return tables


def _too_few_stated(path: Path, what: str) -> InputError:
    return InputError(
        f"{path}: {what} follow the last row that its header counts: the header is damaged, or it counts too "
        "few"
    )


def _ascii_tables(path: Path, elements: list[Element], body: memoryview, first: int) -> dict[str, Columns]:
    text = bytes(body).decode("utf-8", errors="replace")
    lines = [(k, line) for k, line in enumerate(text.splitlines(), first) if line.strip()]
    tables = {}
    for element in elements:
        if len(lines) < element.rows:
            raise truncated(path, element, len(lines))
        tables[element.name] = ascii_rows(path, element, lines[: element.rows])
        lines = lines[element.rows :]
    if lines:
        raise _too_few_stated(path, f"{len(lines)} lines")
    return tables


def _group_by_size(polygons: Any) -> tuple[list[Any], Ints]:
    """Return polygons of equal size together, (k, n) each, and the rows of all."""
    if not isinstance(polygons, list):
        return [polygons], np.arange(len(polygons))
    if not polygons:
        return [], np.arange(0)
    sizes = np.array([len(polygon) for polygon in polygons])
    rows = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    return [np.array([polygons[k] for k in mine]) for mine in rows], np.concatenate(rows)


def _stack_vertices(path: Path, columns: Columns) -> Array:
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"{path}: PLY vertices have no property '{missing[0]}'")
    return np.column_stack([np.asarray(columns[axis], dtype=np.float64) for axis in "xyz"])


def _gather_columns(element: Element, columns: Columns) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Return columns other than geometry, and a sentence for each that has no place: lists that differ in
    length.
    """
    found, said = dict[str, NDArray[Any]](), []
    for prop in element.properties:
        values = columns[prop.name]
        if prop.name in (*GEOMETRY, *CORNERS):
            continue
        if isinstance(values, list):
            said.append(
                f"list property '{prop.name}' of element '{element.name}' is left out: its lists differ in "
                "length"
            )
        elif np.size(values):  # lists may all be empty
            found[prop.name] = typed(np.asarray(values, dtype=np.float64), prop.kind)
    return gather_fields(found), said


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
