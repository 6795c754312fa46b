"""The VTK dialect that CARTO imports (CARTOMERGE, CARTOSEG).

Version 3.0, ascii, triangles, one scalar in [0, 1] with its colours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....arrays import Array
from ....errors import InputError, did_you_mean
from ....geometry.surface import Surface
from ...text import join_rows
from ..surface_file import SurfaceFile

ANONYMOUS = "Anon Anon 00000000"
COLOURS = np.array([(0.04, 0.21, 0.25), (0.94, 0.47, 0.12), (0.90, 0.11, 0.14)])
TABLE_SIZE = 256


@dataclass(frozen=True)
class Mapped:
    """One field brought to [0, 1].

    `meaning` says how, for a sidecar, since the file itself loses the unit.
    """

    values: Array
    meaning: Mapping[str, Any]


def map_field(
    surface: Surface, field: str | None = None, limits: tuple[float, float] | None = None
) -> Mapped:
    """Clip a field to limits (default: its least and largest value) and map it to [0, 1].

    Missing values take the lowest. No field gives ones everywhere. Raises InputError for an unknown field or
    limits that are no interval.
    """
    if field is None:
        return Mapped(np.ones(len(surface.vertices)), {"field": None})
    if field not in surface.fields:
        raise InputError(f"the surface has no field '{field}'" + did_you_mean(field, list(surface.fields)))
    values = surface.fields[field]
    if values.ndim != 1 or not np.isfinite(values).any():
        raise InputError(f"field '{field}' must hold one finite number per vertex to be exported as a scalar")
    low, high = limits or (float(np.nanmin(values)), float(np.nanmax(values)))
    if not low <= high or (limits and low == high):
        raise InputError(f"limits {low:g} to {high:g} of field '{field}': the first must be below the second")
    missing = ~np.isfinite(values)
    scaled = np.clip((np.where(missing, low, values) - low) / ((high - low) or 1.0), 0.0, 1.0)
    return Mapped(
        scaled,
        {"field": field, "value_at_0": low, "value_at_1": high, "missing_vertices_at_0": int(missing.sum())},
    )


def encode(surface: Surface, values: Array, patient: str = ANONYMOUS) -> bytes:
    """The file: mm, 0-based triangles, values in [0, 1].

    Raises InputError for 2D surfaces and titles over 255 characters.
    """
    title = f"PatientData {patient}"
    if surface.dimension != 3 or len(title) > 255 or not title.isascii() or not title.isprintable():
        raise InputError(
            "the CARTO dialect needs a surface in 3D and a title line of at most 255 plain ASCII characters"
        )
    n, m = len(surface.vertices), len(surface.faces)
    return "".join(
        [
            f"# vtk DataFile Version 3.0\n{title}\nASCII\nDATASET POLYDATA\nPOINTS {n} float\n",
            join_rows("%.4f %.4f %.4f\n", surface.vertices),
            f"\nPOLYGONS {m} {4 * m}\n",
            join_rows("3 %d %d %d\n", surface.faces),
            f"\nPOINT_DATA {n}\nSCALARS scalars float\nLOOKUP_TABLE lookup_table\n",
            join_rows("%.4f\n", values),
            f"\nLOOKUP_TABLE lookup_table {TABLE_SIZE}\n",
            join_rows("%.4f %.4f %.4f 1.0\n", _colour_table()),
        ]
    ).encode("ascii")


def _colour_table() -> Array:
    at = np.linspace(0.0, len(COLOURS) - 1.0, TABLE_SIZE)
    return np.column_stack([np.interp(at, np.arange(len(COLOURS)), channel) for channel in COLOURS.T])


def write(file: SurfaceFile) -> bytes:
    """Encode with the first scalar field, if there is one, at its own limits."""
    field = next(
        (
            name
            for name, values in file.surface.fields.items()
            if values.ndim == 1 and np.isfinite(values).any()
        ),
        None,
    )
    return encode(file.surface, map_field(file.surface, field).values)
