"""The surfaces of a case folder: prior, truth and further phases."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..case import MILLIMETRES
from ..errors import InputError
from ..geometry.surface import Surface
from .case_coordinates import check_scale, in_millimetres, overruled, surface_in_frame
from .case_settings import Folder
from .meshes.repair import closed_outward
from .meshes.surface_file import SurfaceFile
from .surfaces import read_surface_file

# settings that choose a surface of the prior's file
CHOICE = ("label", "part", "box", "layer", "fill_slices", "form")
log = logging.getLogger("o3dls")


def surface_of(folder: Folder, role: str) -> SurfaceFile | None:
    """Return the surface of a role in mm, None where there is no such file; the prior is closed and
    outward.
    """
    path = folder.find(role)
    if path is None:
        return None
    choice = {key: folder.settings.get(key) for key in CHOICE} if role == "prior" else {}
    file = _read_in_millimetres(folder, path, **choice)
    surface = file.surface
    if surface.dimension != folder.dimension:
        hint = f"say dimension = {surface.dimension} in case.toml"
        raise InputError(f"{path}: is {surface.dimension}D, the case is {folder.dimension}D; {hint}")
    if role != "prior":  # a truth may be open: it is only measured against
        return file
    if "units" not in folder.settings and file.units not in MILLIMETRES:
        check_scale(path, surface.vertices)
    return replace(file, surface=closed_outward(surface, str(path), cap=folder.settings.get("cap", False)))


def _read_in_millimetres(folder: Folder, path: Path, **choice: Any) -> SurfaceFile:
    """Read the surface of a file in mm; what of the file is not in it goes to the log."""
    file = read_surface_file(path, **_stated_settings(folder), **choice)
    file = overruled(path, file, folder.settings.get("units"))
    for note in file.notes:
        log.info("%s: %s", path, note)
    return in_millimetres(folder, path, file)


def _stated_settings(folder: Folder) -> dict[str, str | None]:
    """Return what the case says of files that do not say it themselves."""
    return {key: folder.settings.get(key) for key in ("units", "frame")}


def phases_of(folder: Folder, space: str) -> tuple[Surface, ...]:
    """Return the surfaces in the folder phases/, in the order of their names and in the prior's frame
    `space`.
    """
    found = []
    for path in sorted(
        p for p in (folder.path / "phases").glob("*") if p.is_file() and not p.name.startswith(".")
    ):
        surface = surface_in_frame(_read_in_millimetres(folder, path), space)
        if surface.dimension != folder.dimension:
            raise InputError(f"{path}: is {surface.dimension}D, the case is {folder.dimension}D")
        folder.note(path)
        found.append(surface)
    return tuple(found)
