"""What a surface file says: the surface, its frame, its units, and what else the format carries."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Ints
from ...case import SPACES
from ...errors import InputError, escaped
from ...geometry.face_values import at_vertices
from ...geometry.label_fields import is_label
from ...geometry.surface import Surface
from ...quantities import known_values
from ..text import is_count

NOTICE = "o3dls, research software, not for clinical use"
OPPOSED = 0.5  # share of their length: the mean of vectors at right angles is longer
# programs that always end their last line
END_LINES = re.compile(f"{NOTICE}|Open3D|VTK generated|VCGLIB generated|Visualization Toolkit")


@dataclass(frozen=True, eq=False)
class SurfaceFile:
    """A surface file gives a surface in mm where the format or its author names the units; `space` and
    `units` are 'unknown' where nothing is said. `notes` are sentences on what of the file is not in the
    surface as it stands there.
    """

    surface: Surface
    space: str = "unknown"
    units: str = "unknown"
    metadata: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        path: Path,
        vertices: Array,
        faces: Array | Ints,
        fields: Mapping[str, NDArray[Any]] | None = None,
        *,
        cells: Mapping[str, NDArray[Any]] | None = None,
        header: str = "",
    ) -> SurfaceFile:
        """Return a checked surface; frame and units come from `SPACE=` and `UNITS=` in the header text.
        `cells` are values per face, (m,) or (m, k), which are carried to the vertices.

        Raises InputError naming the file and the row where a vertex, an index or a triangle cannot be.
        """
        stated = dict(re.findall(r"\b(SPACE|UNITS)=(\w+)", header))
        if len(vertices) == 0 or len(faces) == 0:
            raise InputError(
                f"{path}: holds {len(vertices)} vertices and {len(faces)} triangles; a surface needs both"
            )
        bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
        if len(bad):
            raise InputError(
                f"{path}: vertex {bad[0]} is not finite: {vertices[bad[0]]}; {len(bad)} such vertices"
            )
        check_faces(path, faces, len(vertices))
        whole = ~collapsed(faces)
        numbers = {name: np.asarray(values, dtype=np.float64) for name, values in (fields or {}).items()}
        numbers, none = known_values(numbers)
        cells, of_cells = known_values(cells or {})  # before a mean is taken
        surface = Surface(vertices, faces[whole].astype(np.int64), numbers)
        surface, said = _carry_cells(surface, {name: values[whole] for name, values in cells.items()})
        return cls(
            surface,
            known_space(stated.get("SPACE", "unknown")),
            stated.get("UNITS", "unknown").lower(),
            notes=(*none, *of_cells, *said),
        )

    def noted(self, notes: Iterable[str]) -> SurfaceFile:
        """Return this file with further notes before its own."""
        return replace(self, notes=(*notes, *self.notes))


def known_space(stated: str) -> str:
    """Return the frame that a file states in capitals or not; 'unknown' where it is none that is known."""
    return {known.lower(): known for known in SPACES}.get(stated.lower(), "unknown")


def _carry_cells(surface: Surface, cells: Mapping[str, NDArray[Any]]) -> tuple[Surface, list[str]]:
    """Return the surface with values per face carried to its vertices, and a sentence on each."""
    fields, said = dict(surface.fields), []
    for name, values in cells.items():
        what = f"cell data '{escaped(name)}'"
        if name in surface.fields:
            said.append(f"{what} are left out: the points have a field of that name")
            continue
        labels = is_label(name, values)
        fields[name] = at_vertices(surface, values.astype(np.int64) if labels else values)
        how = "the label with the largest area" if labels else "the mean, weighted by area, of the cells"
        said.append(f"{what} are carried to the points: {how} around each")
        if not labels and values.shape[1:] == (3,):
            said += _report_opposed(surface, what, values, fields[name])
    return replace(surface, fields=fields), said


def _report_opposed(surface: Surface, what: str, vectors: Array, means: Array) -> list[str]:
    """Return a sentence where the mean of vectors is short since they oppose each other, as fibres may that
    have no sense.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a file may hold any number
        lengths = at_vertices(surface, np.linalg.norm(vectors, axis=1))
        short = int((np.linalg.norm(means, axis=1) < OPPOSED * lengths).sum())
    return [f"{what} oppose each other around {short} points, where their mean is short"] if short else []


def check_faces(path: Path, faces: Array | Ints, n: int) -> None:
    """Raise InputError where a face names a vertex that is not there, or all faces are collapsed."""
    broken = np.flatnonzero((faces != np.floor(faces)).any(axis=1) | np.isnan(faces).any(axis=1))
    if len(broken):
        raise InputError(
            f"{path}: triangle {broken[0]} has an index that is not a whole number: "
            f"{_format_row(faces[broken[0]])}"
        )
    bad = np.flatnonzero(((faces < 0) | (faces >= n)).any(axis=1))
    if len(bad):
        raise InputError(
            f"{path}: triangle {bad[0]} names vertices {_format_row(faces[bad[0]])}: there are {n}, "
            "counted from 0"
        )
    if collapsed(faces).all():
        raise InputError(
            f"{path}: triangle 0 names one vertex twice: {_format_row(faces[0])}, and so do all others"
        )


def _format_row(indices: Array | Ints) -> str:
    return f"[{', '.join(f'{value:g}' for value in indices)}]"


def collapsed(faces: Array | Ints) -> NDArray[np.bool_]:
    """Return a mask (m,) of faces that name one vertex twice. They have no area and their edges cancel, so a
    surface is the same without.
    """
    return np.asarray((faces == np.roll(faces, 1, axis=1)).any(axis=1))


def check_end(path: Path, data: bytes, header: str) -> None:
    """Raise InputError where the last line has no end though the program that the header names writes one: a
    number may be cut.
    """
    if END_LINES.search(header) and not data.endswith(b"\n"):
        raise InputError(
            f"{path}: the last line has no end, and the program that wrote it ends every line: the file "
            "is truncated"
        )


def left_out(surface: Surface, kept: Collection[str | None] = ()) -> list[str]:
    """Return a sentence on the fields that a format has no room for, where there are any."""
    names = [escaped(name) for name in surface.fields if name not in kept]
    return [f"the format has no room for: {', '.join(names)}"] if names else []


def flatten_fields(fields: Mapping[str, Array], reserved: Collection[str] = ()) -> dict[str, Array]:
    """Return scalar columns for formats without vectors: (n, k) fields become `name_0` ... `name_k-1`; names
    get no white space.
    """
    flat: dict[str, Array] = {}
    for name, values in fields.items():
        ends = [""] if values.ndim == 1 else [f"_{k}" for k in range(values.shape[1])]
        stem = unused(re.sub(r"\s+", "_", name), {*reserved, *flat}, ends)
        flat |= {stem + end: column for end, column in zip(ends, np.atleast_2d(values.T), strict=True)}
    return flat


def unused(name: str, names: Collection[str], ends: Iterable[str] = ("",)) -> str:
    """Return the name, with as many `_` behind it as it takes to be none of the others with any of the ends,
    nor empty.
    """
    while not name or any(name + end in names for end in ends):
        name += "_"
    return name


def gather_fields(flat: Mapping[str, Array]) -> dict[str, Array]:
    """Return the inverse of `flatten_fields`: runs `name_0, name_1, ...` become one (n, k) field where they
    are complete and `name` is free.
    """
    runs: dict[str, set[str]] = {}
    for name in flat:
        stem, _, index = name.rpartition("_")
        if stem and stem not in flat and is_count(index):
            runs.setdefault(stem, set()).add(name)
    whole = {stem: [f"{stem}_{k}" for k in range(len(run))] for stem, run in runs.items() if len(run) > 1}
    whole = {stem: run for stem, run in whole.items() if set(run) == runs[stem]}
    single = {name: values for name, values in flat.items() if not any(name in run for run in whole.values())}
    return single | {stem: np.column_stack([flat[name] for name in run]) for stem, run in whole.items()}
