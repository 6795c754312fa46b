"""openCARP meshes: `.pts` (micrometres), `.elem` (triangles, 0-based), `.lon` and one `.dat` file per field, under one base name."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..geometry import Array, Surface
from .atomic import staged_file
from .surface_file import SurfaceFile
from .text import decode, is_count, join_rows, number_rows, read_bytes

MICROMETRES = 1000.0


def knows(data: bytes) -> bool:
    """A `.pts` or `.elem` file: a count alone on the first line, then three coordinates or an element type."""
    number = rb"[-+.\d][-+.\deE]*"
    point = number + rb"([ \t]+" + number + rb"){2}[ \t]*\r?\n"
    return re.match(rb"\d+[ \t]*\r?\n\s*(" + point + rb"|[A-Z][a-z][ \t]+\d)", data[:400]) is not None


def read(path: Path, data: bytes) -> SurfaceFile:
    """The triangles of a mesh in mm, from either of its two files; fields are the `.dat` files named `<base>_<field>.dat`."""
    points, elements = path.with_suffix(".pts"), path.with_suffix(".elem")
    n, lines = _lines(points)
    vertices = number_rows(lines[:n], 3, points, range(2, n + 2), "point") / MICROMETRES
    m, lines = _lines(elements)
    rows = [line.split() for line in lines[:m]]
    wrong = next((k for k, row in enumerate(rows) if row[0] != "Tr" or len(row) not in (4, 5)), None)
    if wrong is not None:
        found = f"{elements}: line {wrong + 2}: '{lines[wrong][:40]}'"
        raise InputError(f"{found}: only triangles (Tr i j k [tag]) are read; extract the surface first")
    faces = number_rows([" ".join(row[1:4]) for row in rows], 3, elements, range(2, m + 2), "triangle")
    fields = {dat.stem[len(path.stem) + 1 :]: _values(dat, n) for dat in sorted(path.parent.glob(f"{path.stem}_*.dat"))}
    return SurfaceFile.of(elements, vertices, faces, fields, units="mm")


def _lines(path: Path) -> tuple[int, list[str]]:
    """The stated count and at least as many lines after it."""
    lines = [line for line in decode(read_bytes(path), path).splitlines() if line.strip()]
    if not lines or not is_count(lines[0].strip()):
        raise InputError(f"{path}: line 1 must state the number of rows")
    n = int(lines[0])
    if len(lines) - 1 < n:
        raise InputError(f"{path}: states {n} rows and holds {len(lines) - 1}: the file is truncated")
    return n, lines[1:]


def _values(path: Path, n: int) -> Array:
    lines = [line for line in decode(read_bytes(path), path).splitlines() if line.strip()]
    if len(lines) != n:
        raise InputError(f"{path}: holds {len(lines)} values: the mesh has {n} points")
    return number_rows(lines, 1, path, range(1, n + 1), "value")[:, 0]


def write_mesh(path: Path, surface: Surface) -> None:
    """Write `.pts`, `.elem`, `.lon` (the fibre direction 1 0 0 that openCARP must have) and a `.dat` per scalar field."""
    if surface.dimension != 3:
        raise InputError(f"{path}: openCARP meshes are written in 3D")
    m = len(surface.faces)
    texts = {
        path.with_suffix(".pts"): f"{len(surface.vertices)}\n" + join_rows("%.6f %.6f %.6f\n", surface.vertices * MICROMETRES),
        path.with_suffix(".elem"): f"{m}\n" + join_rows("Tr %d %d %d 1\n", surface.faces),
        path.with_suffix(".lon"): "1\n" + "1.000000 0.000000 0.000000\n" * m,
    }
    for name, values in surface.fields.items():
        if values.ndim == 1 and np.isfinite(values).all():  # a .dat file has no word for a missing value
            texts[path.with_name(f"{path.stem}_{re.sub(r'[^A-Za-z0-9_.-]', '_', name)}.dat")] = join_rows("%.9g\n", values)
    for target, text in texts.items():
        with staged_file(target) as staged:
            staged.write_text(text)
