"""What a page brings: files are read as the commands read them, shown at once, and become a case. The working
folder is that of the app, so that paths are said as they are named there.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, did_you_mean
from .picture import draw
from .worker import Message, Tell

if TYPE_CHECKING:
    from ..case import Points

STUDIES = (".zip", ".mat")  # of map files: exports of systems, which `o3dls import` takes
SETTINGS: Mapping[str, type] = {
    "units": str,
    "frame": str,
    "columns": str,
    "prior_of": str,
    "cap": bool,
    "label": int,
    "part": str,
    "layer": int,
    "fill_slices": bool,
    "form": str,
    "sidecar": str,
    "map": str,
}
OF_PRIOR = tuple(key for key in SETTINGS if key not in ("columns", "map", "prior_of"))


def check_settings(given: Any) -> dict[str, Any]:
    """Return the settings that a page gives. Raises InputError for an unknown one, or one of another type."""
    if not isinstance(given, dict):
        raise InputError("settings: must be an object")
    for key, value in given.items():
        if key not in SETTINGS:
            raise InputError(f"settings: {key}: no such setting{did_you_mean(key, list(SETTINGS))}")
        if type(value) is not SETTINGS[key]:
            raise InputError(f"settings: {key} = {value!r}: must be of type {SETTINGS[key].__name__}")
    return given


def is_study(path: Path) -> bool:
    """Return whether a map is the export of a study, and no table of points."""
    return path.is_dir() or path.suffix.lower() in STUDIES


def look(role: str, path: Path, settings: Mapping[str, Any], tell: Tell) -> Message:
    """Read a file in its role (prior, map, landmarks or image); what was read, in lines, and a picture of it.

    Raises Doubt where settings are missing, InputError where it cannot be used.
    """
    lookers = {
        "prior": _look_at_prior,
        "map": _look_at_map,
        "landmarks": _look_at_landmarks,
        "image": _look_at_image,
    }
    return lookers[role](path, settings)


def make(
    name: Path, run: Path, files: Mapping[str, Path | None], settings: Mapping[str, Any], tell: Tell
) -> Message:
    """Make a case folder of the files, as `o3dls init` or `o3dls import` does; what was said, and the command
    that does the same.
    """
    prior, points, landmarks, image = (files.get(role) for role in ("prior", "map", "landmarks", "image"))
    if points is None:
        raise InputError("map: bring the points of the map first")
    given = {key: value for key, value in settings.items() if key != "map"}
    if is_study(points):
        from ..io.mapping.study_import import import_study

        chosen = settings.get("map")
        beside: dict[str, Any] = {"prior": prior, "landmarks": landmarks, "image": image}
        found = import_study(points, chosen, name, **beside, **given)
        said = [*(f"took {line}" for line in found.took), *(f"left {line}" for line in found.left)]
        options = {"map": chosen, **beside, **given}
        return {"said": [*said, *found.notes], "command": command("import", [points, name], options)}
    from ..pipeline.new_case import Inputs, make_case

    if prior is None:
        raise InputError("prior: bring the surface, or the label volume, first")
    make_case(name, Inputs(prior, points, landmarks, image), out=run, **given)
    options = {"prior": prior, "points": points, "landmarks": landmarks, "image": image, **given, "out": run}
    return {"said": [], "command": command("init", [name], options)}


def command(verb: str, arguments: list[Any], options: Mapping[str, Any]) -> str:
    """Write the line of a shell that does the same as the app."""
    parts = ["o3dls", verb, *map(str, arguments)]
    for key, value in options.items():
        if value is not None and value is not False:
            parts += [f"--{key.replace('_', '-')}", *([] if value is True else [str(value)])]
    return shlex.join(parts)


def _look_at_prior(path: Path, settings: Mapping[str, Any]) -> Message:
    from ..io.case_settings import new_folder
    from ..io.case_surfaces import surface_of
    from ..io.images.dicom import check_no_series

    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file")
    check_no_series(path)
    chosen = {key: value for key, value in settings.items() if key in OF_PRIOR and value is not False}
    file = surface_of(new_folder(Path(), {"prior": str(path), **chosen}), "prior")
    if file is None:
        raise InputError(f"{path}: no such file")
    surface = file.surface
    facts = {
        "Surface": f"{len(surface.vertices)} vertices, {len(surface.faces)} triangles",
        "Volume": f"{surface.volume / 1000:.1f} ml",
        "Size": _write_extent(surface.vertices),
        "Units": file.units if file.units != "unknown" else "not stated: taken as mm",
        "Frame": file.space if file.space != "unknown" else "not stated",
    }
    picture = draw(file.space, surface=surface)
    return {"facts": facts, "notes": list(file.notes), "picture": picture}


def _look_at_map(path: Path, settings: Mapping[str, Any]) -> Message:
    from ..columns import column_table

    if is_study(path):
        from ..io.mapping.study import read_study

        found = read_study(path, settings.get("map"))
        facts = {
            "Study": f"{found.vendor}, map {found.name}",
            "Points": _count_types(found.points),
            "Landmarks": ", ".join(found.landmarks) or "none",
            "Size": _write_extent(found.points.of("eam").xyz),
            "Frame": "that of the system",
        }
        notes = [*(f"took {line}" for line in found.took), *(f"left {line}" for line in found.left)]
        shell = None if found.shell is None else found.shell.surface
        picture = draw(found.space, surface=shell, points=found.points)
        return {"facts": facts, "notes": [*notes, *found.notes], "picture": picture}
    points, columns, units, frame = _read_table(path, settings)
    names = points.of("landmark").columns.get("name", ())
    facts = {
        "Points": _count_types(points),
        "Landmarks": ", ".join(map(str, names)) or "none",
        "Size": _write_extent(points.of("eam").xyz),
        "Units": units,
        "Frame": frame,
    }
    notes = [*points.notes, *column_table(columns)]
    return {"facts": facts, "notes": notes, "picture": draw(frame, points=points)}


def _read_table(path: Path, settings: Mapping[str, Any]) -> tuple[Points, dict[str, str], str, str]:
    """Read a table of points; with what became of its columns, its units and its frame."""
    from ..case import MILLIMETRES
    from ..io.case_coordinates import check_scale
    from ..io.points import describe_columns, points_of, read_points_table, scaled

    table = read_points_table(path, 3, settings.get("columns"))
    points = points_of(table, 3)
    stated = str(table.notes.get("units", "unknown"))
    units = stated if stated in MILLIMETRES else str(settings.get("units", "unknown"))
    if units == "unknown":
        check_scale(path, points.xyz)
    points = scaled(points, MILLIMETRES.get(units, 1.0))
    frame = str(table.notes.get("space", "unknown"))
    said = units if units != "unknown" else "not stated: taken as mm"
    return points, describe_columns(table), said, settings.get("frame", frame)


def _look_at_landmarks(path: Path, settings: Mapping[str, Any]) -> Message:
    from ..io.markups import read_places

    marks, units = read_places(path)
    stated = dict(units).get("units", "not stated: taken as mm")
    facts = {"Landmarks": ", ".join(marks.names) or "none", "Units": stated, "Frame": marks.space}
    return {"facts": facts, "notes": [], "picture": None}


def _look_at_image(path: Path, settings: Mapping[str, Any]) -> Message:
    import numpy as np

    from ..io.grey.image import open_volume
    from .picture import draw_slice

    volume = open_volume(path)
    spacing = np.linalg.norm(volume.affine[:3, :3], axis=0)
    facts = {
        "Voxels": " × ".join(map(str, volume.shape)),
        "Spacing": " × ".join(f"{one:.2f}" for one in spacing) + " mm",
        "Frame": volume.space if volume.space != "unknown" else "not stated",
    }
    middle = volume.shape[2] // 2
    picture = draw_slice(volume.slab(middle, middle + 1)[0], (float(spacing[1]), float(spacing[0])))
    return {"facts": facts, "notes": [], "picture": picture}


def _count_types(points: Points) -> str:
    kinds = dict.fromkeys(points.type.tolist())
    return ", ".join(f"{int((points.type == kind).sum())} {kind}" for kind in kinds) or "none"


def _write_extent(xyz: Any) -> str:
    """Write how far places (n, 3) reach along each axis."""
    size = (xyz.max(axis=0) - xyz.min(axis=0)) if len(xyz) else (0.0, 0.0, 0.0)
    return " × ".join(f"{one:.0f}" for one in size) + " mm"
