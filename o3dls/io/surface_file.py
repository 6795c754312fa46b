"""What a surface file says: the surface, its frame, its units, and what else the format carries."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry import Array, Ints, Surface

NOTICE = "o3dls, research software, not for clinical use"
SPACES = ("LPS", "RAS", "unknown")


@dataclass(frozen=True, eq=False)
class SurfaceFile:
    """A surface in mm where the format or its author names the units; `space` and `units` are 'unknown' where nothing is said."""

    surface: Surface
    space: str = "unknown"
    units: str = "unknown"
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls, path: Path, vertices: Array, faces: Array | Ints, fields: Mapping[str, Array] | None = None, *,
        header: str = "", space: str | None = None, units: str | None = None, metadata: Mapping[str, Any] | None = None,
    ) -> SurfaceFile:  # fmt: skip
        """A checked surface; frame and units as given, else from `SPACE=` and `UNITS=` in the header text.

        Raises InputError naming the file and the row where a vertex, an index or a triangle cannot be.
        """
        notes = dict(re.findall(r"\b(SPACE|UNITS)=(\w+)", header))
        space, units = space or notes.get("SPACE"), units or notes.get("UNITS")
        if len(vertices) == 0 or len(faces) == 0:
            raise InputError(f"{path}: holds {len(vertices)} vertices and {len(faces)} triangles; a surface needs both")
        bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
        if len(bad):
            raise InputError(f"{path}: vertex {bad[0]} is not finite: {vertices[bad[0]]}; {len(bad)} such vertices")
        check_faces(path, faces, len(vertices))
        surface = Surface(vertices, faces[~collapsed(faces)].astype(np.int64), fields or {})
        return cls(surface, space if space in SPACES else "unknown", units or "unknown", metadata or {})


def check_faces(path: Path, faces: Array | Ints, n: int) -> None:
    """Raise InputError where a face names a vertex that is not there, or all faces are collapsed."""
    broken = np.flatnonzero((faces != np.floor(faces)).any(axis=1) | np.isnan(faces).any(axis=1))
    if len(broken):
        raise InputError(f"{path}: triangle {broken[0]} has an index that is no whole number: {_row(faces[broken[0]])}")
    bad = np.flatnonzero(((faces < 0) | (faces >= n)).any(axis=1))
    if len(bad):
        raise InputError(f"{path}: triangle {bad[0]} names vertices {_row(faces[bad[0]])}: there are {n}, counted from 0")
    if collapsed(faces).all():
        raise InputError(f"{path}: triangle 0 names one vertex twice: {_row(faces[0])}, and so do all others")


def _row(indices: Array | Ints) -> str:
    return f"[{', '.join(f'{value:g}' for value in indices)}]"


def collapsed(faces: Array | Ints) -> NDArray[np.bool_]:
    """Mask (m,) of faces that name one vertex twice. They have no area and their edges cancel, so a surface is the same without."""
    return np.asarray((faces == np.roll(faces, 1, axis=1)).any(axis=1))


def triangulate(*polygons: Array | Ints) -> Ints:
    """Triangles (m, 3) of blocks of polygons, each block (k, n) with n corners; polygons are cut as fans."""
    fans = [np.stack([block[:, [0, k, k + 1]] for k in range(1, block.shape[1] - 1)], axis=1) for block in polygons if block.shape[1] > 2]
    return np.concatenate([fan.reshape(-1, 3) for fan in fans]) if fans else np.zeros((0, 3), dtype=np.int64)


def flatten_fields(fields: Mapping[str, Array]) -> dict[str, Array]:
    """Scalar columns for formats without vectors: (n, k) fields become `name_0` ... `name_k-1`; names get no white space."""
    flat: dict[str, Array] = {}
    for name, values in fields.items():
        safe = re.sub(r"\s+", "_", name)
        columns = {safe: values} if values.ndim == 1 else {f"{safe}_{k}": values[:, k] for k in range(values.shape[1])}
        flat |= columns
    return flat


def gather_fields(flat: Mapping[str, Array]) -> dict[str, Array]:
    """The inverse of `flatten_fields`: complete runs `name_0, name_1, ...` become one (n, k) field."""
    fields: dict[str, Array] = {}
    for name, values in flat.items():
        stem, _, index = name.rpartition("_")
        if not (stem and index.isdigit() and f"{stem}_0" in flat and f"{stem}_1" in flat):
            fields[name] = values
        elif index == "0":
            run = [f"{stem}_{k}" for k in range(len(flat)) if f"{stem}_{k}" in flat]
            fields[stem] = np.column_stack([flat[k] for k in run])
    return fields
