"""What a file of a mesh format holds besides its faces: places with values."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from ...arrays import Array


@dataclass(frozen=True, eq=False)
class Cloud:
    """A cloud has places (n, 3) with values per place, by name.

    Frame and units are 'unknown' where nothing is said. faces: how many there are; with any it is a surface.
    """

    xyz: Array
    values: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    space: str = "unknown"
    units: str = "unknown"
    faces: int = 0

    @classmethod
    def stated(cls, xyz: Array, values: Mapping[str, NDArray[Any]], header: str, faces: int = 0) -> Cloud:
        """Return a cloud with frame and units from `SPACE=` and `UNITS=` in the text of a header."""
        said = dict(re.findall(r"\b(SPACE|UNITS)=(\w+)", header))
        return cls(xyz, values, said.get("SPACE", "unknown"), said.get("UNITS", "unknown").lower(), faces)
