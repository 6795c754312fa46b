"""Surfaces from and to files: one registry, readers chosen by content, writers by suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..geometry.shells import wall_thickness
from ..geometry.surface import Surface
from .atomic import write_file
from .clouds.registry import is_cloud
from .images import dicom, labels
from .kinds import kind_of
from .matlab import openep
from .meshes import dif, obj, opencarp, ply, polyline, stl, vtk_legacy, vtp
from .meshes.carto import import_vtk, mesh_file
from .meshes.surface_file import SurfaceFile, left_out
from .text import as_utf8, read_bytes

Reader = Callable[..., SurfaceFile]
Writer = Callable[[SurfaceFile], bytes]


@dataclass(frozen=True)
class Format:
    """A format describes one family of surface files.

    How to know it by its bytes, how to read and write it, which options its reader takes, and in sentences
    what of a surface its writer does not keep.
    """

    name: str
    suffixes: tuple[str, ...]
    knows: Callable[[bytes], bool]
    read: Reader
    write: Writer | None = None
    options: tuple[str, ...] = ()
    losses: Callable[[Surface], list[str]] = lambda surface: []


# The one place where formats are known; the first that knows the bytes reads them, so the surest signs come
# first.
FORMATS = (
    Format("ply", (".ply",), ply.knows, ply.read, ply.write),
    Format("vtk", (".vtk",), vtk_legacy.knows, vtk_legacy.read, vtk_legacy.write),
    Format(
        "carto_mesh",
        (".mesh",),
        mesh_file.knows,
        mesh_file.read,
        mesh_file.write,
        ("hidden",),
        mesh_file.losses,
    ),
    Format("vtp", (".vtp",), vtp.knows, vtp.read, vtp.write),
    Format("dif", (".xml", ".dif"), dif.knows, dif.read, dif.write, ("part",), dif.losses),
    Format("openep", (".mat",), openep.knows, openep.read, openep.write, (), openep.losses),
    Format(
        "labels",
        (".nii", ".nii.gz", ".hdr", ".nrrd", ".mha", ".dcm"),
        labels.knows,
        labels.read,
        None,
        ("label", "part", "box", "layer", "fill_slices", "form", "sidecar", "frame"),
    ),
    Format("off", (".off",), obj.knows_off, obj.read_off, obj.write_off, (), left_out),
    Format("opencarp", (".pts", ".elem"), opencarp.knows, opencarp.read, None, ("units",), opencarp.losses),
    Format("stl", (".stl",), stl.knows, stl.read, stl.write, (), left_out),
    Format("obj", (".obj",), obj.knows_obj, obj.read_obj, obj.write_obj, (), left_out),
    # written only: the reader of VTK files reads it
    Format(
        "carto_vtk", (".vtk",), lambda data: False, vtk_legacy.read, import_vtk.write, (), import_vtk.losses
    ),
)

# formats that are in mm by definition, and cannot state another unit
IN_MILLIMETRES = (
    "carto_mesh",
    "carto_vtk",
    "dif",
    "openep",
    "opencarp",
)
WITH_OUTLINES = ("vtk", "vtp")
A_WALL = (
    "encloses a wall {:.2g} thick, with its inner and its outer side, and no chamber: a prior must be the "
    "surface of the blood pool alone (the endocardium)"
)


def read_surface_file(
    path: str | Path, *, units: str | None = None, frame: str | None = None, **options: Any
) -> SurfaceFile:
    """Read a surface with the frame and units that its file states, format told by content.

    `units` and `frame` are those of the file where it does not state them; only a format that would else take
    its standard's, or cannot be read without, asks for them here.

    `label`, `part`, `box`, `layer`, `fill_slices`, `form` and `sidecar` say which surface of several is
    meant, and how; `hidden` keeps CARTO's hidden triangles. Raises InputError, also for an option of no use.
    """
    path = Path(path)
    data = _read_content(path)
    given = {name: value for name, value in options.items() if value is not None and value is not False}
    known = _format_of(data)
    for name, value in (("units", units), ("frame", frame)):
        if value and known and name in known.options:
            given[name] = value
    if known is None and path.suffix.lower() != ".csv":
        if kind := kind_of(data):
            raise InputError(f"{path}: is {kind}")
        names = ", ".join(f.name for f in FORMATS)
        said = f"is not a surface file that o3dls knows ({names}, csv in 2D)"
        raise InputError(f"{path}: {said}; it begins with {data[:16]!r}")
    for name in given:
        if known is None or name not in known.options:
            raise InputError(f"{path}: '{name}' does not apply to a {known.name if known else 'csv'} file")
    file = known.read(path, data, **given) if known else polyline.read_polyline(path)
    thickness = wall_thickness(file.surface)
    return replace(file, notes=(*file.notes, A_WALL.format(thickness))) if thickness else file


def _read_content(path: Path) -> bytes:
    """Read the bytes of a file. Raises InputError also where another one beside it is meant."""
    dicom.check_no_series(path)
    headers = [path.with_suffix(suffix) for suffix in (".hdr", ".nhdr", ".mhd")]
    header = next((header for header in headers if header.is_file()), None)
    if path.suffix.lower() in (".img", ".raw", ".zraw") and header is not None:
        raise InputError(f"{path}: holds voxels alone: name its header, {header.name}")
    return as_utf8(read_bytes(path))


def _format_of(data: bytes) -> Format | None:
    return next((f for f in FORMATS if f.knows(data)), None)


def is_surface(path: str | Path) -> bool:
    """Return whether a file is a surface in a known format and no cloud, or a table of a 2D outline.

    Raises InputError where it cannot be read at all.
    """
    path = Path(path)
    data = _read_content(path)
    if _format_of(data) is not None:
        return not is_cloud(path, data)
    return path.suffix.lower() == ".csv" and polyline.knows(data)


def read_surface(path: str | Path) -> Surface:
    """Read a surface from a file, format told by content; 2D outlines from CSV.

    Parameters
    ----------
    path : str or Path
        a mesh, a label volume or an outline, in a format that docs/files.md names.

    Returns
    -------
    Surface
        `vertices` (n, 3), `faces` (m, 3) and `fields` by name, as the file has them: in its unit and its
        frame. In 2D `vertices` (n, 2) and `faces` (m, 2), which are lines.

    Raises
    ------
    InputError
        where the file is in no known format, is damaged, or holds several surfaces.

    Examples
    --------
    >>> import o3dls
    >>> prior = o3dls.read_surface("case/prior.ply")
    >>> prior.vertices.shape, prior.watertight
    ((5362, 3), True)
    """
    return read_surface_file(path).surface


def write_surface(
    path: str | Path,
    surface: Surface,
    *,
    space: str = "unknown",
    units: str = "mm",
    format: str | None = None,
) -> list[str]:
    """Write a surface in the format of the suffix, or in the named one.

    Parameters
    ----------
    path : str or Path
        the file to write; one that is there is replaced.
    surface : Surface
        its vertices are written as they are, and its fields where the format has room for them.
    space : {"LPS", "RAS", "unknown"}, default "unknown"
        frame of the vertices, stated in the file where the format can.
    units : str, default "mm"
        unit of the vertices, stated in the file where the format can.
    format : str, default that of the suffix
        such as "carto_vtk", where a suffix stands for several formats.

    Returns
    -------
    list of str
        sentences on what of the surface the format does not keep.

    Raises
    ------
    InputError
        where the suffix is another format's, or the format has no room for the dimension or the units.

    Examples
    --------
    >>> import o3dls
    >>> prior = o3dls.read_surface("case/prior.ply")
    >>> o3dls.write_surface("prior.vtp", prior, space="LPS")
    []
    """
    path = Path(path)
    if path.suffix.lower() == ".csv" and format is None:
        polyline.write_polyline(path, surface)
        return left_out(surface, [name for name, values in surface.fields.items() if values.ndim == 1])
    known = _format_for(path, format)
    if surface.dimension != 3 and known.name not in WITH_OUTLINES:
        raise InputError(
            f"{path}: {known.name} is for surfaces in 3D; outlines in 2D are written as csv, vtk or vtp"
        )
    if known.name in IN_MILLIMETRES and units not in ("mm", "unknown"):
        raise InputError(
            f"{path}: {known.name} is in mm by definition, and the surface is in {units}; scale it, or "
            "write ply, vtk or vtp"
        )
    if known.write is None:  # openCARP: several files
        opencarp.write_mesh(path, surface)
    else:
        write_file(path, known.write(SurfaceFile(surface, space, units)))
    return known.losses(surface)


def _format_for(path: Path, format: str | None) -> Format:
    """Return the format to write, by name or suffix. Raises InputError listing what there is."""
    writable = [f for f in FORMATS if f.write or f.name == "opencarp"]
    for known in writable:
        if known.name == format if format else path.suffix.lower() in known.suffixes:
            check_suffix(path, known.name, known.suffixes)
            return known
    names = ", ".join(f"{f.name} ({' '.join(f.suffixes)})" for f in writable)
    raise InputError(f"{path}: cannot write surfaces as '{format or path.suffix}'; there are: {names}")


def check_suffix(path: Path, format: str, suffixes: tuple[str, ...]) -> None:
    """Raise InputError where the name of a file to write does not end as the format's do.

    It would be taken for another.
    """
    if not path.name.lower().endswith(suffixes):
        raise InputError(f"{path}: files of the format {format} end in {' or '.join(suffixes)}")
