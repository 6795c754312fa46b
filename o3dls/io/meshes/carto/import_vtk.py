"""The VTK dialect that CARTO imports (CARTOMERGE, CARTOSEG).

Version 3.0, ascii, triangles, one scalar in [0, 1] with its colours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....arrays import Array
from ....errors import InputError, did_you_mean, escaped
from ....geometry.surface import Surface
from ...text import join_rows
from ..surface_file import SurfaceFile, left_out

ANONYMOUS = "Anon Anon 00000000"
COLOURS = np.array([(0.04, 0.21, 0.25), (0.94, 0.47, 0.12), (0.90, 0.11, 0.14)])
GREY = (0.5, 0.5, 0.5)
TABLE_SIZE = 256
# where the least value lies if some are missing: above the entry of these in the table, even once rounded
LEAST = 2.0 / TABLE_SIZE


@dataclass(frozen=True)
class Mapped:
    """A mapped field is one that was brought to [0, 1].

    `meaning` says how, for a sidecar, since the file itself loses the unit; `notes` are sentences on what a
    reader of the file would not expect; `missing` is whether 0 stands for no value.
    """

    values: Array
    meaning: Mapping[str, Any]
    notes: tuple[str, ...] = ()
    missing: bool = False


def map_field(
    surface: Surface, field: str | None = None, limits: tuple[float, float] | None = None
) -> Mapped:
    """Clip a field to limits (default: its least and largest value) and map it to [0, 1].

    Where values are missing these are 0, and the least is above. A field of one value, and no field, give
    ones everywhere. Raises InputError for an unknown field or limits that are no interval.
    """
    if field is None:
        return Mapped(np.ones(len(surface.vertices)), {"field": None})
    if field not in surface.fields:
        raise InputError(f"the surface has no field '{field}'" + did_you_mean(field, list(surface.fields)))
    values = surface.fields[field]
    if values.ndim != 1 or not np.isfinite(values).any():
        raise InputError(f"field '{field}' must hold one finite number per vertex to be exported as a scalar")
    known = np.isfinite(values)
    low, high = limits or (float(values[known].min()), float(values[known].max()))
    if limits and not low < high:
        raise InputError(f"limits {low:g} to {high:g} of field '{field}': the first must be below the second")
    least = 1.0 if low == high else 0.0 if known.all() else LEAST
    share = np.clip((np.where(known, values, low) - low) / ((high - low) or 1.0), 0.0, 1.0)
    lost = int((~known).sum())
    meaning = {"field": field, "values": [low, high], "at": [least, 1.0], "missing_vertices": lost}
    notes = [f"'{escaped(field)}' is {low:g} everywhere, and is written as 1"] if low == high else []
    if lost:
        meaning["missing_at"] = 0.0
        notes.append(
            f"{lost} of {len(values)} vertices have no '{escaped(field)}': they are 0, grey in the file's "
            f"table of colours, and values begin at {least:.4f}"
        )
    scaled = np.where(known, least + (1.0 - least) * share, 0.0)
    return Mapped(scaled, meaning, tuple(notes), missing=lost > 0)


def encode(surface: Surface, scalar: Mapped, patient: str = ANONYMOUS) -> bytes:
    """Encode the file: mm, 0-based triangles, one scalar in [0, 1] and its colours.

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
            join_rows("%.4f\n", scalar.values),
            f"\nLOOKUP_TABLE lookup_table {TABLE_SIZE}\n",
            join_rows("%.4f %.4f %.4f 1.0\n", _colour_table(scalar.missing)),
        ]
    ).encode("ascii")


def _colour_table(missing: bool) -> Array:
    """Return colours (256, 3) from the least value to the largest; grey for 0 where that stands for none."""
    at = np.linspace(0.0, 1.0, TABLE_SIZE)
    share = (at - LEAST) / (1.0 - LEAST) if missing else at
    stops = np.linspace(0.0, 1.0, len(COLOURS))
    table = np.column_stack([np.interp(share, stops, channel) for channel in COLOURS.T])
    if missing:
        table[0] = GREY
    return table


def write(file: SurfaceFile) -> bytes:
    """Encode with the first scalar field, if there is one, at its own limits."""
    return encode(file.surface, map_field(file.surface, _first_field(file.surface)))


def losses(surface: Surface) -> list[str]:
    """Return sentences on what `write` does not keep as it is."""
    field = _first_field(surface)
    kept = {field} - {None}
    return [*map_field(surface, field).notes, *left_out(surface, kept)]


def _first_field(surface: Surface) -> str | None:
    return next(
        (name for name, values in surface.fields.items() if values.ndim == 1 and np.isfinite(values).any()),
        None,
    )
