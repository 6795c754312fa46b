"""What a finished run is taken away as: files for other programs, and the commands that do the same."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError, did_you_mean
from .bring import command
from .worker import Message, Tell

# format and side, and what it is for
EXPORTS: Mapping[str, tuple[str, str, str]] = {
    "ply": ("ply", "map", "Surface in the map, for MeshLab, CloudCompare, 3D Slicer and most programs."),
    "stl": ("stl", "map", "Surface in the map, for planning and printing; it has no values and no units."),
    "vtp": ("vtp", "map", "Surface in the map with all its values, for ParaView and 3D Slicer."),
    "carto_vtk": ("carto_vtk", "map", "Surface in the map with one value, to be loaded into CARTO 3."),
    "openep": ("openep", "map", "Surface and points for OpenEP in MATLAB."),
    "opencarp": ("opencarp", "map", "Surface for simulations in openCARP, in micrometres."),
    "prior_ply": ("ply", "prior", "The same result in the patient's image: back on the prior, in its frame."),
    "itk": ("itk", "map", "The motion as a transform of ITK, to carry anything else along."),
}


def exports() -> dict[str, str]:
    """Return what a sentence says of each export."""
    return {name: words for name, (_, _, words) in EXPORTS.items()}


def check_export(name: Any) -> str:
    """Return the name of an export. Raises InputError where there is none."""
    if name not in EXPORTS:
        raise InputError(f"export: {name!r}: no such export{did_you_mean(str(name), list(EXPORTS))}")
    return str(name)


def take(run: Path, name: str, tell: Tell) -> Message:
    """Write an export of a run as `o3dls export` does; where, and the command that does the same."""
    from ..runs.export.finished import export_run

    form, side, _ = EXPORTS[name]
    path = export_run(run, format=form, on=side)
    options = {"format": form} | ({} if side == "map" else {"on": side})
    return {"file": path.as_posix(), "command": command("export", [run], options)}


def commands(run: Path) -> list[str]:
    """Return the lines of a shell that show and check a run."""
    return [command("report", [run], {}), command("view", [run], {}), command("next", [run], {})]
