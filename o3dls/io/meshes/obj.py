"""Wavefront OBJ and OFF: plain text geometry; OBJ states frame and units in comments."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...arrays import Array, Ints
from ...errors import InputError, escaped
from ..text import decode, is_count, join_rows, number_rows, rectangle
from .surface_file import NOTICE, SurfaceFile, check_end
from .triangulation import triangulate

# every statement that the format has; those of curves and surfaces are ignored like normals and groups
STATEMENTS = """v vt vn vp f l p g s mg o fo usemtl mtllib usemap maplib bevel c_interp d_interp lod
    shadow_obj trace_obj cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con ctech stech
    bsp bzp cdc cdp res call csh"""
KNOWN = frozenset(STATEMENTS.split())
SEEN = ("v ", "f ", "vn ", "vt ", "#")  # how most lines begin, which need not be taken apart


def knows_obj(data: bytes) -> bool:
    return re.search(rb"^[ \t]*v\s+[-+.\d]", data[:100_000], re.MULTILINE) is not None


def read_obj(path: Path, data: bytes) -> SurfaceFile:
    """Decode an OBJ file; normals, textures and groups are ignored. Raises InputError naming the line."""
    lines = _join_continued(path, [line.strip() for line in decode(data, path).splitlines()])
    notes = _name_unknown(path, lines)
    rows = [k for k, line in enumerate(lines) if line.startswith(("v ", "v\t"))]
    widths = {len(lines[k].split()) for k in rows}
    if not widths <= {4, 5, 7, 8}:
        raise InputError(
            f"{path}: vertices have {sorted(w - 1 for w in widths)} numbers: must be 3, with colours 6"
        )
    table = [
        number_rows([lines[k][1:] for k in rows], w - 1, path, [k + 1 for k in rows], "vertex")
        for w in widths
    ]
    vertices = table[0][:, :3] if table else np.zeros((0, 3))
    faces = [k for k, line in enumerate(lines) if line.startswith(("f ", "f\t"))]
    polygons = _obj_polygons(
        path, [lines[k][1:] for k in faces], [k + 1 for k in faces], np.searchsorted(rows, faces)
    )
    header = "\n".join(line for line in lines[:50] if line.startswith("#"))
    check_end(path, data, header)
    triangles, _ = triangulate(vertices, *polygons)
    for what, found in (("vertices", len(vertices)), ("triangles", len(triangles))):
        stated = re.search(rf"number of {what}: (\d{{1,12}})\b", header)
        if stated and int(stated[1]) != found:
            raise InputError(
                f"{path}: its header states {stated[1]} {what}, there are {found}: the file is truncated"
            )
    return SurfaceFile.of(path, vertices, triangles, header=header).noted(notes)


def _name_unknown(path: Path, lines: list[str]) -> list[str]:
    """Return a sentence on each word at the beginning of lines that is no statement of the format. Raises
    InputError where it is no word: one byte that differs would have a face left out.
    """
    others = [(k, line.split()[0]) for k, line in enumerate(lines, 1) if line and not line.startswith(SEEN)]
    unknown = [(k, word) for k, word in others if word not in KNOWN]
    for k, word in unknown:
        if not re.fullmatch("[A-Za-z_]+", word):
            raise InputError(
                f"{path}: line {k} begins with '{escaped(word[:40])}', which is no statement of OBJ: it is "
                "damaged"
            )
    words = dict.fromkeys(word for _, word in unknown)
    return [f"lines that begin with '{word[:40]}' are left out: OBJ has no such statement" for word in words]


def _join_continued(path: Path, lines: list[str]) -> list[str]:
    """Join each line that ends in a backslash with the next one, which stays as an empty line, so that the
    count of lines holds. In a comment it is a part of a name.

    Raises InputError where the last line is to be continued.
    """
    start = -1
    for k, line in enumerate(lines):
        if start >= 0:
            lines[start] = f"{lines[start][:-1]} {line}"
            lines[k] = ""
        if not line.endswith("\\") or (start < 0 and line.startswith("#")):
            start = -1
        elif start < 0:
            start = k
    if start >= 0:
        raise InputError(
            f"{path}: line {len(lines)}: ends in a backslash, and no line follows: the file is truncated"
        )
    return lines


def _obj_polygons(path: Path, lines: list[str], numbers: list[int], before: Ints) -> list[Array]:
    """Return the corners of the faces, 0-based; `7/1/3` means corner 7, negative indices count back from the
    vertices `before` the face.
    """
    if any("/" in line for line in lines):
        lines = [re.sub(r"/\S*", "", line) for line in lines]
    table = rectangle(lines) if lines else None
    widths = (
        np.array([len(line.split()) for line in lines])
        if table is None
        else np.full(len(lines), table.shape[1])
    )
    polygons = []
    if len(widths) and widths.min() < 3:
        raise InputError(
            f"{path}: line {numbers[int(widths.argmin())]}: a face needs 3 corners, there are {widths.min()}"
        )
    for width in np.unique(widths):
        mine = np.flatnonzero(widths == width)
        corners = number_rows([lines[k] for k in mine], int(width), path, [numbers[k] for k in mine], "face")
        if (corners == 0).any():
            raise InputError(f"{path}: a face names vertex 0: OBJ counts from 1")
        polygons.append(np.where(corners < 0, corners + before[mine, None], corners - 1))
    return polygons


def write_obj(file: SurfaceFile) -> bytes:
    """Encode as OBJ; fields are lost."""
    surface = file.surface
    # comments in the form of Open3D
    counts = f"# number of vertices: {len(surface.vertices)}\n# number of triangles: {len(surface.faces)}\n"
    head = f"# {NOTICE}\n# SPACE={file.space}\n# UNITS={file.units}\n{counts}"
    return (
        head
        + join_rows("v %.9g %.9g %.9g\n", surface.vertices)
        + join_rows("f %d %d %d\n", surface.faces + 1)
    ).encode()


def knows_off(data: bytes) -> bool:
    return re.match(rb"(\s*#[^\n]*\n)*\s*(ST)?C?N?OFF\b", data[:2000]) is not None


def read_off(path: Path, data: bytes) -> SurfaceFile:
    """Decode an ascii OFF file. Raises InputError naming the line."""
    text = decode(data, path)
    lines = [line.partition("#")[0] for line in text.splitlines()] if "#" in text else text.splitlines()
    rows = [(k, line) for k, line in enumerate(lines, 1) if line and not line.isspace()]
    if not rows:
        raise InputError(f"{path}: holds no line but comments")
    first = re.sub(r"^\s*(ST)?C?N?OFF", "", rows[0][1]).strip()
    rows = [(rows[0][0], first), *rows[1:]] if first else rows[1:]
    if not rows or not re.fullmatch(r"\s*\d{1,12}\s+\d{1,12}(\s+\d+)?\s*", rows[0][1]):
        raise InputError(f"{path}: line 2: OFF must state its numbers of vertices and faces")
    n, m = map(int, rows[0][1].split()[:2])
    if len(rows) < 1 + n + m:
        raise InputError(
            f"{path}: OFF declares {n} vertices and {m} faces but ends after {len(rows) - 1} rows: the "
            "file is truncated"
        )
    mine = rows[1 : 1 + n]
    faces = rows[1 + n : 1 + n + m]
    width = len(mine[0][1].split()) if mine else 3
    vertices = number_rows([line for _, line in mine], width, path, [k for k, _ in mine], "vertex")
    if width < 3:
        raise InputError(f"{path}: line {mine[0][0]}: vertex has {width} numbers: must be 3")
    header = "\n".join(line for line in text.splitlines()[:20] if line.startswith("#"))
    check_end(path, data, header)
    vertices = vertices[:, :3]
    triangles, _ = triangulate(vertices, *_off_polygons(path, faces))
    return SurfaceFile.of(path, vertices, triangles, header=header)


def _off_polygons(path: Path, rows: list[tuple[int, str]]) -> list[Array]:
    """Return the corners of the faces; numbers behind them are colours."""
    table = rectangle([line for _, line in rows]) if rows else None
    if (
        table is not None and (table[:, 0] == 3).all() and table.shape[1] > 3
    ):  # a short cut for nearly every file
        return [table[:, 1:4]]
    polygons = []
    words = [line.split() for _, line in rows]
    shapes = np.array([(int(w[0]) if is_count(w[0]) else -1, len(w)) for w in words]).reshape(-1, 2)
    wrong = np.flatnonzero((shapes[:, 0] < 3) | (shapes[:, 0] >= shapes[:, 1]))
    if len(wrong):
        raise InputError(
            f"{path}: line {rows[wrong[0]][0]}: '{rows[wrong[0]][1][:40]}' is not a face: a count and as "
            "many corners"
        )
    for corners, width in np.unique(shapes, axis=0):
        mine = np.flatnonzero((shapes == (corners, width)).all(axis=1))
        table = number_rows([rows[k][1] for k in mine], int(width), path, [rows[k][0] for k in mine], "face")
        polygons.append(table[:, 1 : corners + 1])
    return polygons


def write_off(file: SurfaceFile) -> bytes:
    """Encode as OFF; fields are lost."""
    surface = file.surface
    head = (
        f"OFF\n# {NOTICE}\n# SPACE={file.space} UNITS={file.units}\n{len(surface.vertices)} "
        f"{len(surface.faces)} 0\n"
    )
    return (
        head + join_rows("%.9g %.9g %.9g\n", surface.vertices) + join_rows("3 %d %d %d\n", surface.faces)
    ).encode()
