"""Surfaces from and to files: one registry, readers chosen by content, writers by suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..geometry import Surface
from . import carto_mesh, carto_vtk, dif, labels, obj, opencarp, openep, ply, polyline, stl, vtk_legacy, vtp
from .atomic import staged_file
from .surface_file import SurfaceFile
from .text import read_bytes

Reader = Callable[..., SurfaceFile]
Writer = Callable[[SurfaceFile], bytes]


@dataclass(frozen=True)
class Format:
    """One family of surface files: how to know it by its bytes, how to read and write it, and which options its reader takes."""

    name: str
    suffixes: tuple[str, ...]
    knows: Callable[[bytes], bool]
    read: Reader
    write: Writer | None = None
    options: tuple[str, ...] = ()


# The one place where formats are known; the first that knows the bytes reads them, so the surest signs come first.
FORMATS = (
    Format("ply", (".ply",), ply.knows, ply.read, ply.write),
    Format("vtk", (".vtk",), vtk_legacy.knows, vtk_legacy.read, vtk_legacy.write),
    Format("carto_mesh", (".mesh",), carto_mesh.knows, carto_mesh.read, carto_mesh.write, ("hidden",)),
    Format("vtp", (".vtp",), vtp.knows, vtp.read, vtp.write),
    Format("dif", (".xml", ".dif"), dif.knows, dif.read, dif.write, ("part",)),
    Format("openep", (".mat",), openep.knows, openep.read, openep.write),
    Format("labels", (".nii", ".nii.gz", ".nrrd", ".mha"), labels.knows, labels.read, None, ("label", "part", "box")),
    Format("off", (".off",), obj.knows_off, obj.read_off, obj.write_off),
    Format("opencarp", (".pts", ".elem"), opencarp.knows, opencarp.read),
    Format("stl", (".stl",), stl.knows, stl.read, stl.write),
    Format("obj", (".obj",), obj.knows_obj, obj.read_obj, obj.write_obj),
    Format("carto_vtk", (), lambda data: False, vtk_legacy.read, carto_vtk.write),  # read as any VTK
)


def read_surface_file(path: str | Path, **options: Any) -> SurfaceFile:
    """A surface with the frame and units that its file states, format told by content.

    Options that are not None: `label`, `part`, `box` say which surface of a file with several is meant; `hidden` keeps CARTO's hidden
    triangles. Raises InputError, also for an option that the format has no use for.
    """
    path = Path(path)
    data = read_bytes(path)
    given = {name: value for name, value in options.items() if value is not None}
    known = _known(data)
    if known is None and path.suffix != ".csv":
        names = ", ".join(f.name for f in FORMATS)
        raise InputError(f"{path}: is no surface file that o3dls knows ({names}, csv in 2D); it begins with {data[:16]!r}")
    for name in given:
        if known is None or name not in known.options:
            raise InputError(f"{path}: '{name}' means nothing for a {known.name if known else 'csv'} file")
    return known.read(path, data, **given) if known else SurfaceFile(polyline.read_polyline(path))


def _known(data: bytes) -> Format | None:
    return next((f for f in FORMATS if f.knows(data)), None)


def is_surface(path: str | Path) -> bool:
    """Whether a file is a surface in a known format, or a table of a 2D outline. Raises InputError where it cannot be read at all."""
    data = read_bytes(path)
    return _known(data) is not None or (Path(path).suffix == ".csv" and polyline.knows(data))


def read_surface(path: str | Path) -> Surface:
    """A surface from a file, format told by content; 2D outlines from CSV. Raises InputError."""
    return read_surface_file(path).surface


def write_surface(path: str | Path, surface: Surface, *, space: str = "unknown", units: str = "mm", format: str | None = None) -> None:
    """Write a surface in the format of the suffix, or the named one; `space` and `units` are stated where the format can."""
    path = Path(path)
    if path.suffix == ".csv":
        polyline.write_polyline(path, surface)
        return
    if format == "opencarp" or path.suffix in (".pts", ".elem"):
        opencarp.write_mesh(path, surface)
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
