"""openCARP meshes: `.pts` (micrometres), `.elem` (triangles, 0-based), `.lon` and one `.dat` file per field,
under one base name.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...geometry.surface import Surface
from ..atomic import staged_file
from ..text import decode, is_count, join_rows, number_rows, read_bytes
from .surface_file import SurfaceFile, unused

MICROMETRES = 1000.0


def knows(data: bytes) -> bool:
    """A `.pts` or `.elem` file: a count alone on the first line, then three coordinates or an element
    type.
    """
    number = rb"[-+.\d][-+.\deE]*"
    point = number + rb"([ \t]+" + number + rb"){2}[ \t]*\r?\n"
    return re.match(rb"\d+[ \t]*\r?\n\s*(" + point + rb"|[A-Z][a-z][ \t]+\d)", data[:400]) is not None


def read(path: Path, data: bytes) -> SurfaceFile:
    """The triangles of a mesh in mm, from either of its two files; fields are the `.dat` files named
    `<base>_<field>.dat`.
    """
    points, elements = _part(path, ".pts"), _part(path, ".elem")
    n, lines = _lines(points)
    vertices = number_rows(lines[:n], 3, points, range(2, n + 2), "point") / MICROMETRES
    m, lines = _lines(elements)
    rows = [line.split() for line in lines[:m]]
    wrong = next((k for k, row in enumerate(rows) if row[0] != "Tr" or len(row) not in (4, 5)), None)
    if wrong is not None:
        found = f"{elements}: line {wrong + 2}: '{lines[wrong][:40]}'"
        raise InputError(f"{found}: only triangles (Tr i j k [tag]) are read; extract the surface first")
    faces = number_rows([" ".join(row[1:4]) for row in rows], 3, elements, range(2, m + 2), "triangle")
    fields = {name: _values(dat, n) for name, dat in _dats(path).items()}
    return SurfaceFile.of(elements, vertices, faces, fields, units="mm")


def _part(path: Path, suffix: str) -> Path:
    """A file of the mesh that `path` names by its base or by its `.pts` or `.elem`; in upper case where that
    is.
    """
    named = path.suffix.lower() in (".pts", ".elem")
    return path.with_name(
        (path.stem if named else path.name) + (suffix.upper() if named and path.suffix.isupper() else suffix)
    )


def _dats(path: Path) -> dict[str, Path]:
    """The mesh's `.dat` files by field; `la_fine_lat.dat` is no field of `la` where there is a mesh
    `la_fine`.
    """
    start = _part(path, "").name + "_"
    beside = sorted(p for p in path.parent.glob("*") if p.name.startswith(start))
    others = tuple(f"{p.stem}_" for p in beside if p.suffix.lower() == ".pts")
    return {
        p.stem[len(start) :]: p
        for p in beside
        if p.suffix.lower() == ".dat" and not p.name.startswith(others)
    }


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
    """Write `.pts`, `.elem`, `.lon` (the fibre direction 1 0 0 that openCARP must have) and a `.dat` per
    scalar field.

    Raises InputError where `.dat` files of an earlier mesh of this name would pass for fields of this one.
    """
    if surface.dimension != 3:
        raise InputError(f"{path}: openCARP meshes are written in 3D")
    base = _part(path, "")
    m = len(surface.faces)
    dats = {
        base.with_name(f"{base.name}_{field}.dat"): join_rows("%.9g\n", values)
        for field, values in _writable(surface).items()
    }
    if earlier := sorted(set(_dats(path).values()) - dats.keys()):
        raise InputError(
            f"{earlier[0]}: is a field of an earlier mesh of this name; remove it, or write under "
            "another name"
        )
    texts = {
        _part(path, ".pts"): f"{len(surface.vertices)}\n"
        + join_rows("%.6f %.6f %.6f\n", surface.vertices * MICROMETRES),
        _part(path, ".elem"): f"{m}\n" + join_rows("Tr %d %d %d 1\n", surface.faces),
        _part(path, ".lon"): "1\n" + "1.000000 0.000000 0.000000\n" * m,
    }
    for target, text in (texts | dats).items():
        with staged_file(target) as staged:
            staged.write_text(text)


def _writable(surface: Surface) -> dict[str, Array]:
    """Scalar fields without missing values, for which a .dat file has no word, under names that can stand in
    a file's name.
    """
    found: dict[str, Array] = {}
    for name, values in surface.fields.items():
        if values.ndim == 1 and np.isfinite(values).all():
            found[unused(re.sub(r"[^A-Za-z0-9_.-]", "_", name), found)] = values
    return found
