"""VTP and VTU (XML PolyData and UnstructuredGrid) without vtk: ascii, base64 and raw data, plain or
compressed; frame and units as field data. Only VTP is written.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Ints
from ...errors import InputError
from ..text import integers
from .cells import POLYGON, STRIP, TEXT, Cells, surface_of
from .cloud import Cloud
from .surface_file import NOTICE, SurfaceFile, known_space
from .vtp_arrays import TYPES, Arrays, open_xml

Fields = dict[str, NDArray[Any]]
Stated = tuple[str, str]  # what a file states: its key and its text
# elements of a piece in the order of the cell data, with VTK's number of their kind; `Cells` states its own
KINDS = {"Verts": 2, "Lines": 4, "Polys": POLYGON, "Strips": STRIP, "Cells": 0}


def knows(data: bytes) -> bool:
    return b"<VTKFile" in data[:2000]


def read(path: Path, data: bytes) -> SurfaceFile:
    """Decode a VTP or VTU file; pieces are joined, polygons become triangles, solids their boundary, cell
    data are carried to the points. Raises InputError naming the array that does not fit.
    """
    vertices, cells, on_points, on_cells, notes = parse(path, data)
    file = surface_of(path, vertices, cells, on_points, on_cells)
    return replace(file, space=known_space(notes["SPACE"] or "unknown"), units=notes["UNITS"] or "unknown")


def read_cloud(path: Path, data: bytes) -> Cloud:
    """Decode the points of a VTP or VTU file with their values. Raises InputError."""
    vertices, cells, on_points, _, notes = parse(path, data)
    space, units = notes["SPACE"] or "unknown", (notes["UNITS"] or "unknown").lower()
    return Cloud(vertices, on_points, space, units, cells.faces)


def parse(path: Path, data: bytes) -> tuple[Array, Cells, Fields, Fields, dict[str, str | None]]:
    """Return points, cells, values of both, and what is stated of frame and units."""
    root, appended = open_xml(path, data)
    kind = root.get("type")
    if kind not in ("PolyData", "UnstructuredGrid"):
        raise InputError(f"{path}: is a VTK file of type {kind}: must be PolyData or UnstructuredGrid")
    arrays = Arrays.of(path, root, appended)
    pieces = [_Piece.of(path, arrays, piece) for piece in root.findall(f"{kind}/Piece")]
    if not pieces:
        raise InputError(f"{path}: has no <Piece> of <{kind}>")
    first = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    cells = [
        replace(piece.cells, corners=piece.cells.corners + start)
        for piece, start in zip(pieces, first, strict=False)
    ]
    notes = {name: arrays.text(root, name) for name in ("SPACE", "UNITS")}
    on_points = _join_pieces([piece.point_data for piece in pieces])
    on_cells = _join_pieces([piece.cell_data for piece in pieces])
    vertices = np.concatenate([piece.vertices for piece in pieces])
    return vertices, Cells.joined(cells), on_points, on_cells, notes


@dataclass(frozen=True, eq=False)
class _Piece:
    """This is one piece of the data set in a VTP file."""

    vertices: Array
    cells: Cells
    point_data: Fields
    cell_data: Fields

    @classmethod
    def of(cls, path: Path, arrays: Arrays, piece: ElementTree.Element) -> _Piece:
        n = arrays.count(piece, "NumberOfPoints")
        points = piece.find("Points/DataArray")
        if points is None:
            raise InputError(f"{path}: <Piece> has no <Points><DataArray>")
        vertices = arrays.numbers(points, 3 * n).reshape(-1, 3) if n else np.zeros((0, 3))
        cells = Cells.joined([_read_cells(path, arrays, piece, name) for name in KINDS])
        return cls(
            vertices,
            cells,
            _read_data(arrays, piece, "PointData", n),
            _read_data(arrays, piece, "CellData", len(cells)),
        )


def _read_data(arrays: Arrays, piece: ElementTree.Element, where: str, n: int) -> Fields:
    """Read the arrays of a piece, n rows each."""
    found = {
        array.get("Name", f"array_{k}"): arrays.tuples(array, n)
        for k, array in enumerate(piece.findall(f"{where}/DataArray"))
    }
    text = {array.get("Name", ""): np.zeros(n, dtype=TEXT) for array in piece.findall(f"{where}/Array")}
    return {name: values for name, values in (found | text).items() if name != "Normals"}


def _join_pieces(parts: Sequence[Fields]) -> Fields:
    """Return arrays that all pieces have, one behind the other."""
    names = [
        name
        for name, values in parts[0].items()
        if all(name in part and part[name].shape[1:] == values.shape[1:] for part in parts)
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def _read_cells(path: Path, arrays: Arrays, piece: ElementTree.Element, name: str) -> Cells:
    """Read the cells of one element of a piece; of several kinds in an unstructured grid."""
    n = arrays.count(piece, f"NumberOf{name}")
    if n == 0:
        return Cells.joined([])
    parts = {array.get("Name"): array for array in piece.findall(f"{name}/DataArray")}
    needed = ["connectivity", "offsets", *(["types"] if name == "Cells" else [])]
    if not parts.keys() >= set(needed):
        raise InputError(f"{path}: <{name}> must hold the arrays {', '.join(needed)}")

    def whole(array: str, count: int) -> Ints:
        return integers(arrays.numbers(parts[array], count), f"{path}: <{name}> {array}")

    offsets = np.concatenate([[0], whole("offsets", n)])
    sizes = np.diff(offsets)
    if (sizes < 0).any():
        raise InputError(
            f"{path}: <{name}> offsets fall at cell {int(np.flatnonzero(sizes < 0)[0])}; they must rise"
        )
    cells = Cells.of(sizes, whole("connectivity", int(offsets[-1])), KINDS[name])
    return replace(cells, types=whole("types", n)) if name == "Cells" else cells


def write(file: SurfaceFile) -> bytes:
    """Encode as VTP with zlib-compressed arrays that VTK, ParaView, Slicer and pyvista read; they stand raw
    at the end, as base64 would make them a third larger. 2D outlines become lines at z = 0.
    """
    surface = file.surface
    n, d = surface.vertices.shape
    vertices = np.column_stack([surface.vertices, np.zeros((n, 3 - d))])
    stated = (("SPACE", file.space), ("UNITS", file.units))
    return _encode(vertices, "Polys" if d == 3 else "Lines", surface.faces, surface.fields, stated)


def write_cloud(cloud: Cloud) -> bytes:
    """Encode places as VTP, each with an element that programs show as a point."""
    each = np.arange(len(cloud.xyz)).reshape(-1, 1)
    return _encode(cloud.xyz, "Verts", each, cloud.values, (("SPACE", cloud.space), ("UNITS", cloud.units)))


def _encode(
    vertices: Array, kind: str, elements: Ints, values: Mapping[str, NDArray[Any]], stated: Sequence[Stated]
) -> bytes:
    """Encode vertices (n, 3) with elements (m, k) of a kind of PolyData."""
    n, (m, k) = len(vertices), elements.shape
    raw = _Raw()
    index = np.int32 if k * max(n, m) < 2**31 else np.int64
    fields = "".join(raw.declare(name, one) for name, one in values.items())
    points = raw.declare("Points", vertices)
    cells = raw.declare("connectivity", elements.ravel().astype(index))
    cells += raw.declare("offsets", np.arange(k, k * m + 1, k, dtype=index))
    counts = " ".join(
        f'NumberOf{name}="{m if name == kind else n if name == "Points" else 0}"'
        for name in ("Points", "Verts", "Lines", "Strips", "Polys")
    )
    head = "".join(
        [
            '<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" '
            'header_type="UInt64" ',
            'compressor="vtkZLibDataCompressor">\n<PolyData>\n<FieldData>\n',
            *(_encode_text(name, text) for name, text in (*stated, ("NOTICE", NOTICE))),
            f"</FieldData>\n<Piece {counts}>\n<PointData>\n{fields}</PointData>\n",
            f"<Points>\n{points}</Points>\n<{kind}>\n{cells}</{kind}>\n",
            '</Piece>\n</PolyData>\n<AppendedData encoding="raw">\n_',
        ]
    )
    return b"".join([head.encode(), *raw.packed, b"\n</AppendedData>\n</VTKFile>\n"])


class _Raw:
    """Raw arrays stand packed behind each other; each is declared by where it begins."""

    def __init__(self) -> None:
        self.packed: list[bytes] = []
        self._size = 0

    def declare(self, name: str, values: NDArray[Any]) -> str:
        """Add an array, and return the element that declares it."""
        kind = "Float64" if values.dtype.kind != "i" else "Int32" if values.dtype.itemsize == 4 else "Int64"
        data = values.astype("<" + TYPES[kind]).tobytes()
        packed = zlib.compress(data, 1)
        # sizes: one whole block, and no partial last one
        sizes = np.array([1, len(data), 0, len(packed)], dtype="<u8").tobytes()
        width = 1 if values.ndim == 1 else values.shape[1]
        begin = self._size
        self.packed += [sizes, packed]
        self._size += len(sizes) + len(packed)
        return (
            f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}" '
            f'format="appended" offset="{begin}"/>\n'
        )


def _encode_text(name: str, text: str) -> str:
    codes = " ".join(str(b) for b in (*text.encode(), 0))
    return f'<Array type="String" Name="{name}" NumberOfTuples="1" format="ascii">{codes}</Array>\n'
