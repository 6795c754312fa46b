"""openCARP meshes: `.pts` (micrometres by the standard), `.elem` (triangles, 0-based), `.lon` and one `.dat`
file per field, under one base name.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...arrays import Array, Ints
from ...errors import Doubt, InputError, choices, escaped
from ...geometry.surface import Surface
from ..atomic import staged_files, write_file
from ..text import decode, integers, is_count, join_rows, number_rows, read_bytes
from .cloud import Cloud
from .surface_file import SurfaceFile, left_out, unused

MICROMETRES = 1000.0
MISSING = -10_000.0  # as in CARTO: no voltage, time or force is near it
KNOWN = "_known"  # ends the name of the mask that says where a field has values
LIKELY = (5.0, 1000.0)  # mm; an extent in micrometres outside is that of a file in another unit


def knows(data: bytes) -> bool:
    """Return whether the bytes begin a `.pts` or `.elem` file: a count alone on the first line, then three
    coordinates or an element type.
    """
    number = rb"[-+.\d][-+.\deE]*"
    point = number + rb"([ \t]+" + number + rb"){2}[ \t]*\r?\n"
    return re.match(rb"\d+[ \t]*\r?\n\s*(" + point + rb"|[A-Z][a-z][ \t]+\d)", data[:400]) is not None


def read(path: Path, data: bytes, units: str | None = None) -> SurfaceFile:
    """Read the triangles of a mesh, from either of its two files; fields are the `.dat` files named
    `<base>_<field>.dat`, and `tag` the regions of the triangles, carried to the points.

    In mm, or as they are in the file where `units` says what that is in. Raises InputError too where nothing
    is said and the extent is not one in micrometres, as many files are in mm.
    """
    points, elements = _part_path(path, ".pts"), _part_path(path, ".elem")
    n, lines = _read_lines(points)
    vertices = number_rows(lines[:n], 3, points, range(2, n + 2), "point")
    m, lines = _read_lines(elements)
    rows = [line.split() for line in lines[:m]]
    wrong = next((k for k, row in enumerate(rows) if row[0] != "Tr" or len(row) not in (4, 5)), None)
    if wrong is not None:
        found = f"{elements}: line {wrong + 2}: '{lines[wrong][:40]}'"
        raise InputError(f"{found}: only triangles (Tr i j k [tag]) are read; extract the surface first")
    faces = number_rows([" ".join(row[1:4]) for row in rows], 3, elements, range(2, m + 2), "triangle")
    fields = _apply_masks({name: _read_values(dat, n) for name, dat in _field_paths(path).items()})
    tags = _read_tags(elements, rows)
    file = replace(SurfaceFile.of(elements, vertices, faces, fields, cells=tags), units=units or "mm")
    _check_units(points, file.surface, units)
    return file if units else replace(file, surface=file.surface.with_vertices(vertices / MICROMETRES))


def read_cloud(path: Path, data: bytes) -> Cloud:
    """Read the points of a `.pts` file with the values beside it, in micrometres where they extend as far as
    those of a heart do; a mesh has triangles beside it. Raises InputError.
    """
    n, lines = _read_lines(path)
    xyz = number_rows(lines[:n], 3, path, range(2, n + 2), "point")
    values = _apply_masks({name: _read_values(dat, n) for name, dat in _field_paths(path).items()})
    extent = float(np.linalg.norm(np.ptp(xyz, axis=0))) / MICROMETRES if n else 0.0
    units = "um" if LIKELY[0] <= extent <= LIKELY[1] else "unknown"
    return Cloud(xyz, values, units=units, faces=int(path.with_suffix(".elem").is_file()))


def _read_tags(path: Path, rows: list[list[str]]) -> dict[str, Ints]:
    """Read the regions of the triangles, where these differ: one tag for all says nothing."""
    tags = [row[4] for row in rows if len(row) == 5]
    if len(tags) < len(rows) or len(set(tags)) == 1:
        return {}
    numbers = number_rows(tags, 1, path, range(2, len(rows) + 2), "tag")[:, 0]
    return {"tag": integers(numbers, f"{path}: tag")}


def _apply_masks(fields: dict[str, Array]) -> dict[str, Array]:
    """Return fields with NaN where the mask beside them, as we write it, says that there is no value."""
    for name in [name for name in fields if name + KNOWN in fields]:
        mask = fields[name + KNOWN]
        absent = mask == 0.0
        if absent.any() and np.isin(mask, (0.0, 1.0)).all() and (fields[name][absent] == MISSING).all():
            fields[name] = np.where(absent, np.nan, fields[name])
            del fields[name + KNOWN]
    return fields


def _check_units(path: Path, surface: Surface, units: str | None) -> None:
    """Raise InputError where the extent is not one in micrometres and nothing is said, or is and another unit
    is said.
    """
    with np.errstate(over="ignore"):  # infinite is no likely extent either
        extent = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    likely = LIKELY[0] <= extent / MICROMETRES <= LIKELY[1]
    if not units and not likely:
        raise Doubt(
            f"{path}: states no units, and extends over {extent / MICROMETRES:.3g} mm if it is in um, the "
            f"standard of openCARP, over {extent:.3g} mm if in mm",
            "say --units um or --units mm to convert or run",
            choices("units", ("um", "mm"), "it is in {}"),
        )
    if likely and units not in (None, "um"):
        raise InputError(
            f"{path}: extends over {extent:.6g} {units}, as units say, and over "
            f"{extent / MICROMETRES:.3g} mm if it is in um, the standard of openCARP; say um "
            "(for this file alone: o3dls convert)"
        )


def _part_path(path: Path, suffix: str) -> Path:
    """Return the path of a file of the mesh that `path` names by its base or by its `.pts` or `.elem`; in
    upper case where that is.
    """
    named = path.suffix.lower() in (".pts", ".elem")
    return path.with_name(
        (path.stem if named else path.name) + (suffix.upper() if named and path.suffix.isupper() else suffix)
    )


def _field_paths(path: Path) -> dict[str, Path]:
    """Return the mesh's `.dat` files by field; `la_fine_lat.dat` is no field of `la` where there is a mesh
    `la_fine`.
    """
    start = _part_path(path, "").name + "_"
    beside = sorted(p for p in path.parent.glob("*") if p.name.startswith(start))
    others = tuple(f"{p.stem}_" for p in beside if p.suffix.lower() == ".pts")
    return {
        p.stem[len(start) :]: p
        for p in beside
        if p.suffix.lower() == ".dat" and not p.name.startswith(others)
    }


def _read_lines(path: Path) -> tuple[int, list[str]]:
    """Read the stated count and at least as many lines after it."""
    lines = [line for line in decode(read_bytes(path), path).splitlines() if line.strip()]
    if not lines or not is_count(lines[0].strip()):
        raise InputError(f"{path}: line 1 must state the number of rows")
    n = int(lines[0])
    if len(lines) - 1 < n:
        raise InputError(f"{path}: states {n} rows and holds {len(lines) - 1}: the file is truncated")
    return n, lines[1:]


def _read_values(path: Path, n: int) -> Array:
    lines = [line for line in decode(read_bytes(path), path).splitlines() if line.strip()]
    if len(lines) != n:
        raise InputError(f"{path}: holds {len(lines)} values: the mesh has {n} points")
    return number_rows(lines, 1, path, range(1, n + 1), "value")[:, 0]


def write_mesh(path: Path, surface: Surface) -> None:
    """Write `.pts`, `.elem`, `.lon` (the fibre direction 1 0 0 that openCARP must have) and a `.dat` per
    scalar field, with a mask where values are missing.

    Raises InputError as check_fields does.
    """
    if surface.dimension != 3:
        raise InputError(f"{path}: openCARP meshes are written in 3D")
    check_fields(path, surface)
    m = len(surface.faces)
    texts = {
        ".pts": f"{len(surface.vertices)}\n" + join_rows("%.6f %.6f %.6f\n", surface.vertices * MICROMETRES),
        ".elem": f"{m}\n" + join_rows("Tr %d %d %d 1\n", surface.faces),
        ".lon": "1\n" + "1.000000 0.000000 0.000000\n" * m,
    }
    with staged_files(path) as staged:
        for suffix, text in texts.items():
            write_file(_part_path(staged, suffix), text)
        for field, values in _writable_fields(surface).items():
            write_file(_field_path(staged, field), join_rows("%.9g\n", values))


def check_fields(path: Path, surface: Surface) -> None:
    """Raise InputError where `.dat` files of an earlier mesh of this name would pass for fields of this
    surface.
    """
    own = {_field_path(path, field) for field in _writable_fields(surface)}
    if earlier := sorted(set(_field_paths(path).values()) - own):
        raise InputError(
            f"{earlier[0]}: is a field of an earlier mesh of this name; remove it, or write under "
            "another name"
        )


def _field_path(path: Path, field: str) -> Path:
    base = _part_path(path, "")
    return base.with_name(f"{base.name}_{field}.dat")


def losses(surface: Surface) -> list[str]:
    """Return sentences on what `write_mesh` does not keep as it is."""
    scalars = {name: values for name, values in surface.fields.items() if values.ndim == 1}
    lost = {name: int((~np.isfinite(values)).sum()) for name, values in scalars.items()}
    return [
        *(
            f"{count} of {len(surface.vertices)} vertices have no '{escaped(name)}': they are {MISSING:g} "
            f"there, and 0 in a mask, the .dat file of the same name with {KNOWN}"
            for name, count in lost.items()
            if count
        ),
        *left_out(surface, scalars),
    ]


def _writable_fields(surface: Surface) -> dict[str, Array]:
    """Return scalar fields under names that can stand in a file's name; one with missing values has a mask
    beside it, 1 where there is a value, since a .dat file has no word for none.
    """
    found: dict[str, Array] = {}
    for name, values in surface.fields.items():
        if values.ndim == 1:
            known = np.isfinite(values)
            ends = ("",) if known.all() else ("", KNOWN)
            stem = unused(re.sub(r"[^A-Za-z0-9_.-]", "_", name), found, ends)
            found[stem] = np.where(known, values, MISSING)
            if not known.all():
                found[stem + KNOWN] = known.astype(np.float64)
    return found
