"""Closed polylines (2D surfaces) in CSV: `x,y`, a column `loop` where there are several; further columns are
fields.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...arrays import Array, Ints
from ...errors import InputError
from ...geometry.surface import Surface
from ..table import read_table, write_table
from .surface_file import SurfaceFile


def knows(data: bytes) -> bool:
    """Return whether a table names x and y, but not z, in its first line that is no comment."""
    header = next(
        (line for line in data[:4000].splitlines() if line.strip() and not line.startswith(b"#")), b""
    )
    names = {name.strip().lower() for name in re.split(rb"[,;\t]", header.removeprefix(b"\xef\xbb\xbf"))}
    return {b"x", b"y"} <= names and b"z" not in names


def read_polyline(path: str | Path) -> SurfaceFile:
    """Read closed outlines of a CSV file and what it states; a repeated last point is dropped, and a single
    loop is turned counter-clockwise.

    Several loops keep their direction, since holes run clockwise. Raises InputError below 3 points a loop.
    """
    table = read_table(path, "xy", {"x": "x", "y": "y"})
    xy = np.column_stack([table.numbers("x"), table.numbers("y")])
    fields = {
        name: table.numbers(name, missing=True) for name in table.columns if name not in ("x", "y", "loop")
    }
    label = table.numbers("loop") if "loop" in table.columns else np.zeros(len(xy))
    loops = [_drop_repeated(xy, np.flatnonzero(label == value)) for value in np.unique(label)]
    if min(map(len, loops), default=0) < 3:
        raise InputError(
            f"{path}: a closed outline needs at least 3 points; there are {min(map(len, loops), default=0)}"
        )
    if len(loops) == 1 and _enclosed_area(xy[loops[0]]) < 0:
        loops = [loops[0][::-1]]
    starts = np.cumsum([0, *map(len, loops)])
    faces = np.concatenate(
        [start + _ring_segments(len(rows)) for start, rows in zip(starts, loops, strict=False)]
    )
    order = np.concatenate(loops)
    surface = Surface(xy[order], faces, {name: values[order] for name, values in fields.items()})
    return SurfaceFile(surface, table.notes.get("space", "unknown"), table.notes.get("units", "unknown"))


def _drop_repeated(xy: Array, rows: Ints) -> Ints:
    """Return rows of one loop without a repeated last point."""
    return rows[:-1] if len(rows) > 1 and np.allclose(xy[rows[0]], xy[rows[-1]]) else rows


def _ring_segments(n: int) -> Ints:
    index = np.arange(n)
    return np.column_stack([index, np.roll(index, -1)])


def _enclosed_area(xy: Array) -> float:
    """Return the signed area, positive counter-clockwise."""
    return float((xy[:, 0] * np.roll(xy[:, 1], -1) - xy[:, 1] * np.roll(xy[:, 0], -1)).sum() / 2)


def write_polyline(path: str | Path, surface: Surface) -> None:
    """Write a closed 2D surface that `read_polyline` reads back. Raises InputError where a segment has no one
    next segment.
    """
    if surface.dimension != 2 or not surface.watertight:
        raise InputError(f"{path}: only closed polylines in 2D can be written as csv")
    loops = trace_loops(surface.faces)
    order = np.concatenate(loops)
    columns = {"x": surface.vertices[order, 0], "y": surface.vertices[order, 1]}
    if len(loops) > 1:
        columns["loop"] = np.repeat(np.arange(len(loops)), list(map(len, loops)))
    scalars = {name: values[order] for name, values in surface.fields.items() if values.ndim == 1}
    write_table(path, {**columns, **scalars})


def trace_loops(segments: Ints) -> list[Ints]:
    """Return vertex indices of the closed loops that directed segments (m, 2) form, each vertex having one
    next at most.
    """
    after = dict(segments.tolist())
    loops = []
    while after:
        start, vertex = next(iter(after.items()))
        loop = [start]
        del after[start]
        while vertex != start:
            loop.append(vertex)
            vertex = after.pop(vertex)
        loops.append(np.array(loop, dtype=np.int64))
    return loops
