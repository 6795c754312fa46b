"""What the import of a study gives, whatever the vendor."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...arrays import Array
from ...case import Points
from ...errors import InputError
from ..meshes.surface_file import SurfaceFile


@dataclass
class Imported:
    """This is one imported map of a study, with sentences on what was taken and left, and notes on the files.

    Points with landmarks in the map frame, and the system's own shell; `columns` says of each column of the
    vendor's tables of points what became of it.
    """

    points: Points
    landmarks: dict[str, Array] = field(default_factory=dict)
    shell: SurfaceFile | None = None
    space: str = "unknown"
    vendor: str = ""
    registrations: dict[str, tuple[float, ...]] = field(default_factory=dict)
    shells: dict[str, SurfaceFile] = field(default_factory=dict)
    name: str = "map"
    took: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    columns: dict[str, str] = field(default_factory=dict)

    @contextmanager
    def optional(self, part: str) -> Iterator[None]:
        """Take a part of a study that a case does not need: where it cannot be read, that is said under
        `left`.
        """
        try:
            yield
        except InputError as error:
            self.left.append(f"{part}: {error}")


def joined(first: Points, second: Points) -> Points:
    """Return two sets of points as one; a column that only one has is missing (NaN, or empty text) for the
    other.
    """

    def column(points: Points, name: str, like: Any) -> Any:
        empty = np.full(len(points), np.nan) if like.dtype.kind == "f" else np.full(len(points), "")
        return points.columns.get(name, empty)

    names = {**second.columns, **first.columns}
    columns = {
        name: np.concatenate([column(first, name, like), column(second, name, like)])
        for name, like in names.items()
    }
    xyz, kinds = np.vstack([first.xyz, second.xyz]), np.concatenate([first.type, second.type])
    return Points(xyz, kinds, columns, notes=(*first.notes, *second.notes))
