"""Files that are told by their content to hold points alone, and their tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..meshes import opencarp, ply, vtk_legacy, vtp
from ..meshes.cloud import Cloud
from ..meshes.surface_file import flatten_fields
from ..table import Table
from . import pcd


@dataclass(frozen=True)
class Format:
    """A format of clouds has a way to know it by its bytes, and a way to read it."""

    knows: Callable[[bytes], bool]
    read: Callable[[Path, bytes], Cloud]


FORMATS = (
    Format(ply.knows, ply.read_cloud),
    Format(vtk_legacy.knows, vtk_legacy.read_cloud),
    Format(vtp.knows, vtp.read_cloud),
    Format(pcd.knows, pcd.read_cloud),
    Format(opencarp.knows, opencarp.read_cloud),
)


def _format_of(data: bytes) -> Format | None:
    return next((one for one in FORMATS if one.knows(data)), None)


def is_cloud(path: Path, data: bytes) -> bool:
    """Return whether a file is in a format of clouds and has no faces. Raises InputError where it is
    damaged.
    """
    known = _format_of(data)
    return known is not None and known.read(path, data).faces == 0


def cloud_table(path: Path, data: bytes, aliases: Mapping[str, str]) -> Table | None:
    """Return the points of a cloud as a table; None where the bytes are in no format of clouds. Raises
    InputError where it is damaged, or a surface.
    """
    if (known := _format_of(data)) is None:
        return None
    cloud = known.read(path, data)
    if cloud.faces:
        raise InputError(
            f"{path}: is a surface, and points are measured places; if its vertices were measured, save them "
            "alone, as a cloud or a table"
        )
    values = {name: one for name, one in cloud.values.items() if one.dtype.kind in "fiu"}
    columns = dict(zip("xyz", cloud.xyz.T, strict=True))
    for name, one in flatten_fields(values, tuple("xyz")).items():
        columns.setdefault(aliases.get(name.lower(), name), np.where(np.isfinite(one), one, np.nan))
    cells = {name: _format_numbers(one) for name, one in columns.items()}
    notes = {"space": cloud.space, "units": cloud.units}
    notes = {key: value for key, value in notes.items() if value != "unknown"}
    return Table(path, cells, list(range(len(cloud.xyz))), notes, row="point")


def _format_numbers(values: NDArray[Any]) -> list[str]:
    """Return numbers as the cells of a table, whole ones without a point."""
    whole = values.dtype.kind in "iu" or (np.isfinite(values) & (values == np.floor(values))).all()
    numbers = (values.astype(np.int64) if whole and (abs(values) < 1 << 53).all() else values).tolist()
    return ["" if one != one else repr(one) for one in numbers]
