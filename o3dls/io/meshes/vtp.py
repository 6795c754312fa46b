"""VTP (XML PolyData) without vtk: ascii, base64 and raw data, plain or compressed; frame and units as field
data.
"""

from __future__ import annotations

import base64
import zlib
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from ...arrays import Array, Ints
from ...errors import InputError
from ..text import integers
from .surface_file import NOTICE, SurfaceFile
from .triangulation import strips, triangulate
from .vtp_arrays import Arrays, open_xml


def knows(data: bytes) -> bool:
    return b"<VTKFile" in data[:2000]


def read(path: Path, data: bytes) -> SurfaceFile:
    """Decode a VTP file; pieces are joined, polygons become triangles. Raises InputError naming the array
    that does not fit.
    """
    root, appended = open_xml(path, data)
    if root.get("type") != "PolyData":
        raise InputError(f"{path}: is a VTK file of type {root.get('type')}: must be PolyData")
    arrays = Arrays.of(path, root, appended)
    pieces = root.findall("PolyData/Piece")
    if not pieces:
        raise InputError(f"{path}: has no <Piece> of <PolyData>")
    vertices = []
    polygons = list[Array]()
    fields = list[dict[str, Array]]()
    start = 0
    for piece in pieces:
        n = arrays.count(piece, "NumberOfPoints")
        vertices.append(
            arrays.numbers(_only(path, piece, "Points/DataArray"), 3 * n).reshape(-1, 3)
            if n
            else np.zeros((0, 3))
        )
        cells = [*_cells(path, arrays, piece, "Polys"), *strips(_cells(path, arrays, piece, "Strips"))]
        polygons += [block + start for block in cells]
        found = [
            (array.get("Name", f"array_{k}"), arrays.tuples(array, n))
            for k, array in enumerate(piece.findall("PointData/DataArray"))
        ]
        fields.append({name: values for name, values in found if name != "Normals"})
        start += n
    names = [
        name
        for name in fields[0]
        if all(name in f and f[name].shape[1:] == fields[0][name].shape[1:] for f in fields)
    ]
    joined = {name: np.concatenate([f[name] for f in fields]) for name in names}
    notes = {name: arrays.text(root, name) for name in ("SPACE", "UNITS")}
    xyz = np.concatenate(vertices)
    return SurfaceFile.of(
        path, xyz, triangulate(xyz, *polygons)[0], joined, space=notes["SPACE"], units=notes["UNITS"]
    )


def _only(path: Path, piece: ElementTree.Element, where: str) -> ElementTree.Element:
    found = piece.find(where)
    if found is None:
        raise InputError(f"{path}: <Piece> has no <{where.replace('/', '><')}>")
    return found


def _cells(path: Path, arrays: Arrays, piece: ElementTree.Element, kind: str) -> list[Array]:
    """Blocks of Polys or Strips of equal size."""
    n = arrays.count(piece, f"NumberOf{kind}")
    if n == 0:
        return []
    parts = {array.get("Name"): array for array in piece.findall(f"{kind}/DataArray")}
    if not {"connectivity", "offsets"} <= parts.keys():
        raise InputError(f"{path}: <{kind}> must hold the arrays connectivity and offsets")
    offsets = integers(
        np.concatenate([[0.0], arrays.numbers(parts["offsets"], n)]), f"{path}: <{kind}> offsets"
    )
    lengths = np.diff(offsets)
    if (lengths < 0).any():
        raise InputError(
            f"{path}: <{kind}> offsets fall at cell {int(np.flatnonzero(lengths < 0)[0])}; they must rise"
        )
    corners = arrays.numbers(parts["connectivity"], int(offsets[-1]))
    return [corners[offsets[:-1][lengths == k, None] + np.arange(k)] for k in np.unique(lengths)]


def write(file: SurfaceFile) -> bytes:
    """Encode as VTP with zlib-compressed arrays that VTK, ParaView, Slicer and pyvista read. 2D outlines
    become lines at z = 0.
    """
    surface = file.surface
    n, d = surface.vertices.shape
    m = len(surface.faces)
    xyz = np.column_stack([surface.vertices, np.zeros((n, 3 - d))])
    cells = _array("connectivity", surface.faces.ravel()) + _array("offsets", np.arange(d, d * m + 1, d))
    kind = "Polys" if d == 3 else "Lines"
    counts = (
        f'NumberOfPoints="{n}" NumberOfVerts="0" NumberOfLines="{m * (d == 2)}" NumberOfStrips="0" '
        f'NumberOfPolys="{m * (d == 3)}"'
    )
    return "".join(
        [
            '<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" '
            'header_type="UInt64" ',
            'compressor="vtkZLibDataCompressor">\n<PolyData>\n<FieldData>\n',
            *(
                _text(name, text)
                for name, text in (("SPACE", file.space), ("UNITS", file.units), ("NOTICE", NOTICE))
            ),
            f"</FieldData>\n<Piece {counts}>\n<PointData>\n",
            *(_array(name, values) for name, values in surface.fields.items()),
            f"</PointData>\n<Points>\n{_array('Points', xyz)}</Points>\n<{kind}>\n{cells}</{kind}>\n",
            "</Piece>\n</PolyData>\n</VTKFile>\n",
        ]
    ).encode()


def _array(name: str, values: Array | Ints) -> str:
    kind, data = (
        ("Int64", values.astype("<i8")) if values.dtype.kind == "i" else ("Float64", values.astype("<f8"))
    )
    width = 1 if values.ndim == 1 else values.shape[1]
    packed = zlib.compress(data.tobytes(), 1)
    head = np.array([1, data.nbytes, 0, len(packed)], dtype="<u8")  # one whole block, no partial last one
    text = (base64.b64encode(head.tobytes()) + base64.b64encode(packed)).decode()
    return (
        f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}" '
        f'format="binary">{text}</DataArray>\n'
    )


def _text(name: str, text: str) -> str:
    codes = " ".join(str(b) for b in (*text.encode(), 0))
    return f'<Array type="String" Name="{name}" NumberOfTuples="1" format="ascii">{codes}</Array>\n'
