"""Surfaces from and to files: one registry, readers chosen by content, writers by suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..geometry import Surface
from . import carto_vtk, obj, ply, polyline, stl, vtk_legacy, vtp
from .atomic import staged_file
from .surface_file import SurfaceFile
from .text import read_bytes

Reader = Callable[[Path, bytes], SurfaceFile]
Writer = Callable[[SurfaceFile], bytes]


@dataclass(frozen=True)
class Format:
    """One family of surface files: how to know it by its first bytes, how to read and write it."""

    name: str
    suffixes: tuple[str, ...]
    knows: Callable[[bytes], bool]
    read: Reader
    write: Writer | None = None


FORMATS = (
    Format("ply", (".ply",), ply.knows, ply.read, ply.write),
    Format("vtk", (".vtk",), vtk_legacy.knows, vtk_legacy.read, vtk_legacy.write),
    Format("vtp", (".vtp",), vtp.knows, vtp.read, vtp.write),
    Format("off", (".off",), obj.knows_off, obj.read_off, obj.write_off),
    Format("stl", (".stl",), stl.knows, stl.read, stl.write),
    Format("obj", (".obj",), obj.knows_obj, obj.read_obj, obj.write_obj),
    Format("carto_vtk", (), lambda data: False, vtk_legacy.read, carto_vtk.write),  # read as any VTK
)


def read_surface_file(path: str | Path) -> SurfaceFile:
    """A surface with the frame and units that its file states, format told by content. Raises InputError."""
    path = Path(path)
    data = read_bytes(path)
    if path.suffix == ".csv":
        return SurfaceFile(polyline.read_polyline(path))
    for known in FORMATS:
        if known.knows(data):
            return known.read(path, data)
    names = ", ".join(known.name for known in FORMATS)
    raise InputError(f"{path}: is no surface file that o3dls knows ({names}, csv in 2D); it begins with {data[:16]!r}")


def read_surface(path: str | Path) -> Surface:
    """A surface from a file, format told by content; 2D outlines from CSV. Raises InputError."""
    return read_surface_file(path).surface


def write_surface(path: str | Path, surface: Surface, *, space: str = "unknown", units: str = "mm", format: str | None = None) -> None:
    """Write a surface in the format of the suffix, or the named one; `space` and `units` are stated where the format can."""
    path = Path(path)
    if path.suffix == ".csv":
        polyline.write_polyline(path, surface)
        return
    encode = writer_for(path, format)
    with staged_file(path) as staged:
        staged.write_bytes(encode(SurfaceFile(surface, space, units)))


def writer_for(path: Path, format: str | None = None) -> Writer:
    """The encoder of a format by name or suffix. Raises InputError listing what there is."""
    for known in FORMATS:
        if known.write and (known.name == format if format else path.suffix.lower() in known.suffixes):
            return known.write
    names = ", ".join(f"{f.name} ({' '.join(f.suffixes)})" for f in FORMATS if f.write)
    raise InputError(f"{path}: cannot write surfaces as '{format or path.suffix}'; there are: {names}")
