"""What the headings of coordinates say: which axis a column is, and in which units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ...case import MILLIMETRES
from ...errors import InputError

# ParaView writes vectors so, of which only the points are places
VECTOR = re.compile(r"(?:points|coordinates|positions?)[ _]?[:_]([012])", re.IGNORECASE)
UNIT = "|".join([*MILLIMETRES, "µm", "μm"])  # the sign of micro, and the Greek letter
WITH_UNIT = re.compile(rf"([xyz])(?:\s*[\[(]\s*({UNIT})\s*[\])]|[_\s]({UNIT}))", re.IGNORECASE)


def read_axes(path: Path, top: str, header: Sequence[str]) -> tuple[list[str], str | None]:
    """Return the names of columns with `x` for headings such as `x (mm)`, `X_mm` and `Points:0`, and the
    units that they state; a heading that is an axis already comes first. Raises InputError where they differ.
    """
    taken = {name.lower() for name in header} & {"x", "y", "z"}
    names, units = list(header), dict[str, str]()
    for k, name in enumerate(header):
        if (found := WITH_UNIT.fullmatch(name.strip())) and found[1].lower() not in taken:
            names[k] = found[1].lower()
            units[name] = re.sub("[µμ]", "u", (found[2] or found[3]).lower())
        elif (found := VECTOR.fullmatch(name.strip())) and "xyz"[int(found[1])] not in taken:
            names[k] = "xyz"[int(found[1])]
    if len(set(units.values())) > 1:
        raise InputError(
            f"{path}: {top}: columns {', '.join(units)} differ in their units; write them in one"
        )
    return names, next(iter(units.values()), None)
