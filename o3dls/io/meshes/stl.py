"""STL, binary and ascii: triangles without sharing, so equal vertices are merged; frame and units stand in
the header.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import InputError
from ...geometry.surface import Surface
from ..text import decode, number_rows
from .repair import welded
from .surface_file import SurfaceFile

TRIANGLE = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
UNIT = 0.01  # tolerance of the length of normals, which programs round


def knows(data: bytes) -> bool:
    """Return whether the bytes are STL: a binary file is known by its size, which is checked first since its
    header may begin with `solid`.
    """
    return _is_binary(data) or (re.match(rb"\s*solid\b", data[:80]) is not None and b"facet" in data[:2000])


def _is_binary(data: bytes) -> bool:
    """Return whether the stated triangles fill the file, or their rows look as facets do and something
    follows.
    """
    if len(data) <= 84:
        return False
    n = _stated_count(data)
    size = 84 + TRIANGLE.itemsize * n
    return len(data) == size or (
        n > 0 and len(data) > size and bool(_look_like_facets(_binary_rows(data, n)).all())
    )


def _stated_count(data: bytes) -> int:
    return int(np.frombuffer(data, "<u4", 1, 80)[0])


def _binary_rows(data: bytes, n: int, first: int = 0) -> NDArray[Any]:
    return np.frombuffer(data, TRIANGLE, n, 84 + TRIANGLE.itemsize * first)


def _look_like_facets(rows: NDArray[Any]) -> NDArray[np.bool_]:
    """Return a mask (n,) of rows that can be triangles: normals of length 1, or 0 as some programs write, and
    finite corners.
    """
    with np.errstate(all="ignore"):  # the bytes may be anything
        length = np.linalg.norm(rows["normal"].astype(np.float64), axis=1)
    unit = (np.abs(length - 1.0) < UNIT) | (length == 0.0)
    return np.asarray(unit & np.isfinite(rows["corners"]).all(axis=(1, 2)))


def read(path: Path, data: bytes) -> SurfaceFile:
    """Decode an STL file. Raises InputError where a triangle is incomplete, or there are more than stated."""
    notes = []
    if _is_binary(data):
        n = _stated_count(data)
        corners = _binary_rows(data, n)["corners"].reshape(-1, 3).astype(np.float64)
        header = data[:80].decode("ascii", errors="replace")
        if behind := len(data) - 84 - TRIANGLE.itemsize * n:
            _check_behind(path, data, n)
            notes.append(f"{behind} bytes behind the last triangle are left out")
    else:
        corners, header = _read_ascii(path, data)
    faces = np.arange(len(corners)).reshape(-1, 3)
    file = SurfaceFile.of(path, corners, faces, header=header).noted(notes)
    return replace(file, surface=welded(file.surface))


def _check_behind(path: Path, data: bytes, n: int) -> None:
    """Raise InputError where what follows the stated triangles is one more of them."""
    if len(data) < 84 + TRIANGLE.itemsize * (n + 1):
        return
    row = _binary_rows(data, 1, n)
    if (
        _look_like_facets(row)[0] and np.ptp(row["corners"], axis=1).any()
    ):  # zeros that fill up a block are none
        raise InputError(
            f"{path}: states {n} triangles, and another follows: the count is wrong, or two files were joined"
        )


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
