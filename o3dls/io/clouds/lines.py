"""Lines in space from VTK's files, such as a path of a catheter or a vein's middle, and to legacy VTK."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ..meshes import vtk_legacy, vtp
from ..meshes.cells import Cells
from ..meshes.cloud import Cloud
from ..meshes.surface_file import NOTICE

LINES = (3, 4)  # VTK's numbers of a line and of a line of several pieces


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines have places (n, 3) with values per place, cells that name the places of each line, and frame and
    units, 'unknown' where nothing is said.
    """

    xyz: Array
    cells: Cells
    values: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    space: str = "unknown"
    units: str = "unknown"


def read_lines(path: Path, data: bytes) -> Lines | None:
    """Read the lines of a VTK file; None where it is none, has none, or has faces. Raises InputError where it
    is damaged.
    """
    if vtp.knows(data):
        xyz, cells, values, _, _ = vtp.parse(path, data)
        cloud: Cloud = vtp.read_cloud(path, data)
    elif vtk_legacy.knows(data):
        xyz, cells, values, _, _ = vtk_legacy.parse(path, data)
        cloud = vtk_legacy.read_cloud(path, data)
    else:
        return None
    if cells.faces or not cells.count(*LINES):
        return None
    numbers = {name: value for name, value in values.items() if value.dtype.kind in "fiu"}
    return Lines(xyz, cells, numbers, cloud.space, cloud.units)


def encode_lines(lines: Lines) -> bytes:
    """Encode as legacy VTK 4.2, binary; values of numbers stay, elements that are points do not."""
    corners = _each_line(lines.cells)
    flat = np.concatenate([np.r_[len(line), line] for line in corners])
    n = len(lines.xyz)
    title = f"{NOTICE} SPACE={lines.space} UNITS={lines.units}"
    head = f"# vtk DataFile Version 4.2\n{title}\nBINARY\nDATASET POLYDATA\nPOINTS {n} double\n"
    parts = [head.encode(), lines.xyz.astype(">f8").tobytes()]
    parts += [f"\nLINES {len(corners)} {flat.size}\n".encode(), flat.astype(">i4").tobytes()]
    if lines.values:
        parts.append(f"\nPOINT_DATA {n}\nFIELD FieldData {len(lines.values)}\n".encode())
    for name, values in lines.values.items():
        width = 1 if values.ndim == 1 else values.shape[1]
        parts += [f"{quote(name)} {width} {n} double\n".encode(), values.astype(">f8").tobytes(), b"\n"]
    return b"".join(parts) + b"\n"


def _each_line(cells: Cells) -> list[NDArray[np.int64]]:
    ends = np.cumsum(cells.sizes)
    return [
        np.asarray(cells.corners[end - size : end], dtype=np.int64)
        for size, end, kind in zip(cells.sizes, ends, cells.types, strict=True)
        if kind in LINES
    ]
