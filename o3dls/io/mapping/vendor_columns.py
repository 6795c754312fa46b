"""What an import makes of each column of a vendor's own tables, in words."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

import numpy as np

from ...columns import GROUP
from ..matlab import mat, openep
from ..text import decode
from . import ensite, ensite_rows
from .carto_points import COLUMNS, SITES

LEFT = "left"
PLACED = dict(zip(("roving x", "roving y", "roving z"), "xyz", strict=True))
DECIDES = "taken to choose the points that the map uses"
JOINS = "taken to join the files of the map"
ROWS = {
    **{theirs: f"taken as {ours}" for theirs, ours in PLACED.items()},
    "pt number": JOINS,
    "peak2peak": "taken as bipolar",
    "rov LAT": "taken as lat, less ref LAT, times 1000",
    "ref LAT": "taken from rov LAT",
    "utilized": DECIDES,
}
# members of `electric`: the column that they become
MEMBERS = {"voltages.bipolar": "bipolar", "voltages.unipolar": "unipolar", "annotations.mapAnnot": "lat"}
CAR_PLACES = {5: "taken as x", 6: "taken as y", 7: "taken as z"}


def columns_of_car() -> dict[str, str]:
    """Return what became of the columns of `_car.txt`, which have no headings and are counted from 1."""
    values = {column + 1: f"taken as {name}" for name, column in COLUMNS.items()}
    became = {3: "taken to find the tags of the point", **CAR_PLACES, **values}
    return {f"_car.txt, column {k}": became.get(k, LEFT) for k in range(1, max(became) + 1)} | {
        f"_car.txt, columns from {max(became) + 1}": LEFT
    }


def columns_of_sites(path: Path, data: bytes) -> dict[str, str]:
    """Return what became of the columns of VisiTag's sites."""
    header = next((line.split() for line in decode(data, path).splitlines() if line.strip()), [])
    ours = {**SITES, **{axis.upper(): axis for axis in "xyz"}}
    return {f"{path.name}, {name}": f"taken as {ours[name]}" if name in ours else LEFT for name in header}


def columns_of_ensite(path: Path, data: bytes) -> dict[str, str]:
    """Return what became of the columns of a table of EnSite, or of the rows of an older one."""
    if ensite_rows.knows(data):
        names, became = ensite_rows.row_names(path, data), ROWS
    else:
        export = ensite.parse(path, data, tuple(PLACED))
        became = {theirs: f"taken as {ours}" for theirs, ours in PLACED.items()}
        became |= {"force (g)": "taken as force", ensite.NUMBER: JOINS, "utilized": DECIDES}
        became |= {ensite.MOMENT: f"taken as {GROUP}"}
        if (found := ensite.map_column(export)) is not None:
            theirs, ours = found
            became |= {
                theirs: f"taken as {ours}",
                f"{theirs} valid": "taken to leave out values that are not",
            }
        names = export.header
    return {f"{path.name}, {name}": became.get(name, LEFT) for name in names if name}


def columns_of_lesions(path: Path, data: bytes) -> dict[str, str]:
    """Return what became of the columns of a table of EnSite's ablation points."""
    export, places = ensite.parse_lesions(path, data)
    ours = {**ensite.LESION_VALUES, **dict(zip(places, "xyz", strict=True))}
    names = filter(None, export.header)
    return {f"{path.name}, {name}": f"taken as {ours[name]}" if name in ours else LEFT for name in names}


def columns_of_openep(path: Path, data: bytes, taken: Collection[str]) -> dict[str, str]:
    """Return what became of the members of `electric`, where the columns that are `taken` came of it."""
    electric = mat.at(openep.userdata(path, data), "electric")
    became = {name: f"taken as {ours}" for name, ours in MEMBERS.items() if ours in taken}
    became["egmX"] = "taken as x, y, z"
    if "lat" in taken:
        became |= dict.fromkeys(("annotations.referenceAnnot", "sampleFrequency"), "taken to count lat in ms")
    if "tags" in taken:
        became["tags"] = "kept as text"
    became["include"] = DECIDES
    return {f"electric.{name}": became.get(name, LEFT) for name in _list_members(electric)}


def _list_members(found: object, before: str = "") -> Iterable[str]:
    """Yield the names of what a struct holds that is not empty, with a point between those of inner ones."""
    if not isinstance(found, Mapping):
        return
    for name, value in found.items():
        if isinstance(value, Mapping):
            yield from _list_members(value, f"{before}{name}.")
        elif np.size(np.asarray(value, dtype=object)):
            yield before + name
