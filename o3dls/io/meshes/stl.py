"""STL, binary and ascii: triangles without sharing, so equal vertices are merged; frame and units stand in
the header.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...geometry.surface import Surface
from ..text import decode, number_rows
from .repair import welded
from .surface_file import SurfaceFile

TRIANGLE = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def knows(data: bytes) -> bool:
    """Binary STL is known by its size, which is checked first since a binary header may begin with
    `solid`.
    """
    return _is_binary(data) or (re.match(rb"\s*solid\b", data[:80]) is not None and b"facet" in data[:2000])


def _is_binary(data: bytes) -> bool:
    return len(data) > 84 and len(data) == 84 + 50 * int(np.frombuffer(data, "<u4", 1, 80)[0])


def read(path: Path, data: bytes) -> SurfaceFile:
    """Decode an STL file. Raises InputError where a triangle is incomplete."""
    if _is_binary(data):
        corners = np.frombuffer(data, TRIANGLE, offset=84)["corners"].reshape(-1, 3).astype(np.float64)
        header = data[:80].decode("ascii", errors="replace")
    else:
        corners, header = _read_ascii(path, data)
    faces = np.arange(len(corners)).reshape(-1, 3)
    file = SurfaceFile.of(path, corners, faces, header=header)
    return SurfaceFile(welded(file.surface), file.space, file.units)


def _read_ascii(path: Path, data: bytes) -> tuple[Array, str]:
    lines = decode(data, path).splitlines()
    rows = [k for k, line in enumerate(lines) if line.lstrip().startswith("vertex")]
    if not any(line.lstrip().startswith("endsolid") for line in lines[-5:]) or len(rows) % 3:
        raise InputError(f"{path}: line {len(lines)}: STL ends without 'endsolid'; the file is truncated")
    corners = number_rows(
        [lines[k].replace("vertex", " ", 1) for k in rows], 3, path, [k + 1 for k in rows], "vertex"
    )
    return corners, lines[0]


def write(file: SurfaceFile) -> bytes:
    """Encode as binary STL; coordinates become float32, fields are lost."""
    surface: Surface = file.surface
    rows = np.zeros(len(surface.faces), dtype=TRIANGLE)
    rows["normal"] = surface.face_normals
    rows["corners"] = surface.vertices[surface.faces]
    header = f"o3dls research software, not for clinical use SPACE={file.space} UNITS={file.units}".encode(
        "ascii", "replace"
    )
    return header[:80].ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()
