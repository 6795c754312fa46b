"""Named points: of 3D Slicer, `.mrk.json` read and written, `.fcsv` read; and plain JSON, read."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..case import MILLIMETRES as LENGTHS
from ..errors import InputError
from ..geometry.similarity import TURN, apply
from .atomic import write_file
from .documents import parse_json
from .table import read_table
from .text import cells_of, check_numbers, decode, read_bytes

SCHEMA = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/markups-schema-v1.0.3.json#"
MILLIMETRES = {"mm": 1.0, "um": 0.001, "cm": 10.0, "m": 1000.0}
PLAIN_NAMES = ("id", "name", "label")  # of places in plain JSON
PLAIN_PLACES = ("coordinates", "position", "point", "xyz")
OLD_FRAMES = {"0": "RAS", "1": "LPS", "RAS": "RAS", "LPS": "LPS"}


@dataclass(frozen=True, eq=False)
class Markups:
    """Markups are named positions (n, 3) in mm with the frame they are in; names need not differ."""

    names: tuple[str, ...]
    xyz: Array
    space: str

    def in_space(self, space: str) -> Markups:
        """Return the same places in LPS or RAS. Raises InputError where either frame is unknown."""
        if self.space == space:
            return self
        if {self.space, space} != {"LPS", "RAS"}:
            raise InputError(f"markups are in frame '{self.space}': cannot be brought to '{space}'")
        return Markups(self.names, apply(TURN, self.xyz), space)


def read_markups(path: str | Path, frame: str | None = None) -> Markups:
    """Read defined control points of a `.mrk.json` or `.fcsv` file, or named places of plain JSON, told by
    content; `frame` is that of a file that states none: an old `.fcsv` cannot be read without, places of
    plain JSON are in frame 'unknown'. Raises InputError.
    """
    path = Path(path)
    text = decode(read_bytes(path), path)
    if text.lstrip()[:1] not in ("{", "[") and path.suffix.lower() != ".json":
        return _read_fcsv(path, text, frame)
    tree = parse_json(text, str(path))
    if isinstance(tree, dict) and ("markups" in tree or "@schema" in tree):
        return _read_slicer(path, tree)
    return _read_plain(path, tree, frame or "unknown")


def _read_plain(path: Path, tree: Any, frame: str) -> Markups:
    """Read the places of a list of objects, as scalismo and statismo write it, or of an object by name."""
    if isinstance(tree, dict):
        named = list(tree.items())
    elif isinstance(tree, list) and all(isinstance(item, dict) for item in tree):
        named = [(_first_of(item, PLAIN_NAMES), _first_of(item, PLAIN_PLACES)) for item in tree]
    else:
        named = []
    for name, place in named or [(None, None)]:
        if not isinstance(name, str) or not _is_place(place):
            raise InputError(
                f"{path}: is JSON, but no named places: must be Slicer's markups, a list of objects such as "
                f'{{"id": "LSPV", "coordinates": [1, 2, 3]}}, or one object {{"LSPV": [1, 2, 3]}}'
                + ("" if name is None else f"; '{str(name)[:40]}' has {str(place)[:60]}")
            )
    xyz = np.array([place for _, place in named], dtype=np.float64)
    return Markups(tuple(str(name) for name, _ in named), xyz, frame)


def _first_of(item: Mapping[str, Any], keys: Sequence[str]) -> Any:
    return next((item[key] for key in keys if key in item), None)


def _is_place(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(type(v) in (int, float) and abs(v) < 1e9 for v in value)
    )


def _read_slicer(path: Path, tree: dict[str, Any]) -> Markups:
    lists = tree.get("markups")
    if not isinstance(lists, list) or not lists or not all(isinstance(item, dict) for item in lists):
        raise InputError(f"{path}: has no list 'markups'; it is not a Slicer markups file")
    found = [_json_points(path, item) for item in lists]
    spaces = {part.space for part in found}
    if len(spaces) > 1:
        raise InputError(
            f"{path}: its markups are in different frames ({', '.join(sorted(spaces))}); save them in one"
        )
    return Markups(
        tuple(n for part in found for n in part.names),
        np.concatenate([part.xyz for part in found]),
        spaces.pop(),
    )


def _json_points(path: Path, item: Mapping[str, Any]) -> Markups:
    """Return the points of one markup; its own frame and units are honoured, or refused."""
    space, units = item.get("coordinateSystem", "LPS"), item.get("coordinateUnits", "mm")
    units = units[0] if isinstance(units, list) and units else units
    # a tuple, since the value may be a list, which has no hash
    if space not in ("LPS", "RAS") or units not in tuple(MILLIMETRES):
        raise InputError(
            f"{path}: coordinateSystem '{space}' must be LPS or RAS, coordinateUnits '{units}' one of "
            f"{', '.join(MILLIMETRES)}"
        )
    names, rows = [], []
    points = item.get("controlPoints", [])
    for k, point in enumerate(points if isinstance(points, list) else [points]):
        if not isinstance(point, dict):
            raise InputError(f"{path}: control point {k} is not an object")
        if point.get("positionStatus", "defined") != "defined":
            continue
        position = point.get("position")
        if not _is_place(position):
            raise InputError(
                f"{path}: control point {k} ('{point.get('label', '')}') has position "
                f"{str(position)[:60]}: must be three numbers"
            )
        label = point.get("label")
        names.append("" if label is None else str(label))
        rows.append(position)
    return Markups(tuple(names), np.array(rows, dtype=np.float64).reshape(-1, 3) * MILLIMETRES[units], space)


def _fcsv_frame(path: Path, text: str, frame: str | None) -> str:
    stated = re.search(r"^#\s*CoordinateSystem\s*=[ \t]*(\w*)", text, re.MULTILINE)
    if stated is None and frame in ("LPS", "RAS"):
        return frame
    if stated is None:
        raise InputError(
            f"{path}: states no '# CoordinateSystem = LPS' or RAS, and without it left and right cannot be "
            "told; state it with o3dls convert --frame (Slicer wrote RAS before it stated any)"
        )
    if stated[1] not in OLD_FRAMES:
        raise InputError(
            f"{path}: CoordinateSystem = '{stated[1]}': must be one of {', '.join(OLD_FRAMES)} (0 is "
            "RAS, 1 LPS)"
        )
    return OLD_FRAMES[stated[1]]


def _read_fcsv(path: Path, text: str, frame: str | None) -> Markups:
    space = _fcsv_frame(path, text, frame)
    columns = re.search(r"^#\s*columns\s*=\s*(.+)$", text, re.MULTILINE)
    header = [name.strip() for name in columns[1].split(",")] if columns else []
    if not {"x", "y", "z", "label"} <= set(header):
        raise InputError(f"{path}: its line '# columns =' must name x, y, z and label")
    names, rows = [], []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = cells_of(line, ",", f"{path}: line {number}")
        if len(cells) < len(header):
            raise InputError(f"{path}: line {number} has {len(cells)} cells: the columns are {len(header)}")
        row = dict(zip(header, cells, strict=False))
        position = [row[axis] for axis in "xyz"]
        check_numbers(position, 3, f"{path}: line {number}", "coordinate")
        names.append(row["label"])
        rows.append([float(cell) for cell in position])
    xyz = np.array(rows, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(xyz).all():
        raise InputError(
            f"{path}: point '{names[int(np.flatnonzero(~np.isfinite(xyz).all(axis=1))[0])]}' is not finite"
        )
    return Markups(tuple(names), xyz, space)


def write_markups(
    path: str | Path, markups: Markups, descriptions: Sequence[str] = (), *, locked: bool = False
) -> None:
    """Write `.mrk.json` in the frame of the points, which must be known; with what is said of each point, and
    `locked` against being moved by the mouse.
    """
    if markups.space not in ("LPS", "RAS"):
        raise InputError(f"{path}: Slicer must know the frame; it is '{markups.space}': must be LPS or RAS")
    facing = (
        [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0]
        if markups.space == "LPS"
        else np.eye(3).ravel().tolist()
    )
    flags = {"selected": True, "locked": False, "visibility": True, "positionStatus": "defined"}
    said = descriptions or [""] * len(markups.names)
    points = [
        {
            "id": str(k),
            "label": name,
            "description": text,
            "associatedNodeID": "",
            "position": xyz,
            "orientation": facing,
            **flags,
        }
        for k, (name, xyz, text) in enumerate(zip(markups.names, markups.xyz.tolist(), said, strict=True), 1)
    ]
    item = {
        "type": "Fiducial",
        "coordinateSystem": markups.space,
        "coordinateUnits": "mm",
        "locked": locked,
        "labelFormat": "%N-%d",
    }
    whole = {"@schema": SCHEMA, "markups": [{**item, "controlPoints": points}]}
    write_file(path, json.dumps(whole, indent=1) + "\n")


def read_places(path: Path) -> tuple[Markups, dict[str, str]]:
    """Read Slicer markups or a table `name,x,y,z`, in mm where the units are stated, and a note of the units
    where they are.

    Raises InputError.
    """
    if path.suffix.lower() in (".json", ".fcsv"):
        return read_markups(path), {"units": "mm"}
    table = read_table(path, ("name", "x", "y", "z"))
    units = table.notes.get("units", "unknown")
    if units not in (*LENGTHS, "unknown"):
        raise InputError(f"{path}: states units '{units}': must be one of {', '.join(LENGTHS)}")
    xyz = np.column_stack([table.numbers(axis) for axis in "xyz"]) * LENGTHS.get(units, 1.0)
    marks = Markups(tuple(table.columns["name"]), xyz, table.notes.get("space", "unknown"))
    return marks, {} if units == "unknown" else {"units": "mm"}
