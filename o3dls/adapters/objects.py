"""Surfaces and points as objects of other libraries, and back: the one place where these are converted.

An object is known by the name of its class, so that no library is imported that is not in use already.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, masked_in, without_masked
from ..case import Points
from ..errors import InputError, did_you_mean
from ..geometry.similarity import TURN
from ..geometry.surface import Surface
from ..io.images import labels
from ..io.images.labels import Choice
from ..io.images.registry import checked
from ..io.meshes.surface_file import SurfaceFile, flatten_fields
from ..io.points import points_from
from ..quantities import known_values
from .arrays import columns_of, plain_array
from .images import IMAGES
from .keywords import keyword_errors
from .meshes import MESHES, POINT_READERS, to_meshio, to_open3d, to_pyvista, to_trimesh

__all__ = [
    "points_of",
    "stated_surface",
    "surface_of",
    "to",
    "to_meshio",
    "to_open3d",
    "to_pyvista",
    "to_trimesh",
]

KINDS: Mapping[str, Callable[[Surface], Any]] = {
    "open3d": to_open3d,
    "trimesh": to_trimesh,
    "pyvista": to_pyvista,
    "meshio": to_meshio,
}
SURFACES = (
    "a mesh of Open3D (legacy or tensor), trimesh, pyvista, vtk (vtkPolyData) or meshio, a pair of arrays "
    "(vertices, faces), a Surface of o3dls, or a label volume of SimpleITK or nibabel (NIfTI)"
)
CLOUDS = (
    "a cloud of Open3D (legacy or tensor), trimesh, pyvista, vtk (vtkPolyData) or meshio, an array or tensor "
    "(n, 3), columns with x, y and z in a mapping, a DataFrame or a structured array, or Points of o3dls"
)


def to(surface: Surface, kind: str) -> Any:
    """Return a surface as an object of another library, with its fields as values per point.

    Parameters
    ----------
    surface : Surface
        in 3D; its vertices are taken as they are.
    kind : {"open3d", "trimesh", "pyvista", "meshio"}
        the library; meshes of Open3D are of its tensor interface.

    Returns
    -------
    mesh of the library

    Raises
    ------
    InputError
        for another kind, in 2D, and where the library is not installed.

    Examples
    --------
    >>> import o3dls
    >>> prior = o3dls.read_surface("case/prior.ply")
    >>> o3dls.to(prior, "trimesh").vertices.shape
    (5362, 3)
    """
    if kind not in KINDS:
        raise InputError(f"no kind of mesh '{kind}'" + did_you_mean(kind, list(KINDS)))
    return KINDS[kind](surface)


def surface_of(thing: Any, *, frame: str | None = None, **choice: Unpack[Choice]) -> Surface:
    """Return the surface of a mesh, of arrays, or of a label volume, with its fields.

    Parameters
    ----------
    thing : mesh, arrays (vertices, faces), or label volume
        of Open3D, trimesh, pyvista, vtk or meshio; vertices (n, 3), faces (m, 3); SimpleITK or nibabel.
    frame : {"LPS", "RAS"}, default None
        frame that a label volume shall come in: LPS unless it is RAS. Of other objects nothing is turned.
    **choice
        `label`, `part`, `box`, `layer`, `fill_slices` of a label volume, `form` of a NIfTI.

    Returns
    -------
    Surface
        in the unit of the object; of a label volume in mm.

    Raises
    ------
    InputError
        for anything else.

    Examples
    --------
    >>> import o3dls
    >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> round(o3dls.surface_of((corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])).volume, 3)
    0.167
    """
    return stated_surface(thing, "mesh", frame=frame, **choice).surface


def stated_surface(thing: Any, where: str, *, frame: str | None = None, **choice: Any) -> SurfaceFile:
    """Return the same as `surface_of`, with the frame and units where the object states them, as label
    volumes do; `where` names it in errors.
    """
    with keyword_errors():
        return _read_surface(thing, where, frame, choice)


def _read_surface(thing: Any, where: str, frame: str | None, choice: Mapping[str, Any]) -> SurfaceFile:
    given = {name: value for name, value in choice.items() if value is not None and value is not False}
    if (image := _find_reader(IMAGES, thing)) is not None:
        form = given.pop("form", None)
        file = labels.surface_of(checked(image(thing, where, frame, form), where), where, **given)
        if {file.space, frame} == {"LPS", "RAS"}:
            return SurfaceFile(file.surface.transformed(TURN), str(frame), file.units, file.metadata)
        return file
    if given:
        raise InputError(
            f"{where}: '{next(iter(given))}' does not apply to {_class_name(thing)}, only to label volumes"
        )
    if isinstance(thing, Surface):
        fields, said = known_values(thing.fields)
        return SurfaceFile(replace(thing, fields=fields) if said else thing, notes=said)
    read = _read_pair if isinstance(thing, tuple | list) and len(thing) == 2 else _find_reader(MESHES, thing)
    if read is None:
        raise InputError(
            f"{where}: an object of type {_class_name(thing)} is not a surface: must be {SURFACES}"
        )
    vertices, faces, fields, cells = read(thing, where)
    if (
        vertices.ndim != 2
        or vertices.shape[1] not in (2, 3)
        or faces.ndim != 2
        or faces.shape[1] != vertices.shape[1]
    ):
        raise InputError(
            f"{where}: vertices have shape {vertices.shape} and faces {faces.shape}: must be (n, 3) and "
            "(m, 3), in the plane (n, 2) and (m, 2)"
        )
    # copies: a library shares its memory, and a mesh is there to be edited; words are no field of a surface
    numbers = {name: np.array(values, dtype=np.float64) for name, values in _keep_numbers(fields).items()}
    at = np.array(vertices, dtype=np.float64)
    return SurfaceFile.of(Path(where), at, faces, numbers, cells=_keep_numbers(cells))


def _keep_numbers(values: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return those values that are numbers, truth being 0 or 1."""
    arrays = {name: without_masked(one) for name, one in values.items()}
    return {
        name: one.astype(np.int64) if one.dtype.kind == "b" else one
        for name, one in arrays.items()
        if one.dtype.kind in "iufb"
    }


def _read_pair(thing: Any, where: str) -> tuple[Array, Any, dict[str, Any], dict[str, Any]]:
    try:
        vertices, faces = (without_masked(plain_array(part)).astype(np.float64) for part in thing)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(f"{where}: a pair must hold vertices and faces as arrays of numbers") from None
    return vertices, faces, {}, {}


def points_of(thing: Any, where: str = "points") -> Points:
    """Return points of type eam, or of the types in a column `type`, with the values that the object has per
    point, by the names that files use (`bipolar`, `lat`, `sigma`, ...).

    Parameters
    ----------
    thing : point cloud, array or tensor (n, 3), or columns by name
        of Open3D, trimesh, pyvista, vtk or meshio; columns have x, y and z, (n,) each: a mapping, a
        DataFrame, or a structured array.
    where : str, default "points"
        what errors name it.

    Returns
    -------
    Points
        `xyz` (n, 3) in the unit and frame of the object.

    Raises
    ------
    InputError
        for anything else, and for values that cannot have been measured.

    Examples
    --------
    >>> import o3dls
    >>> o3dls.points_of({"x": [1, 2], "y": [0, 0], "z": [0, 0], "bipolar": [0.4, 1.5]}).columns["bipolar"]
    array([0.4, 1.5])
    """
    if isinstance(thing, Points):
        return thing
    read = _find_reader(POINT_READERS, thing)
    if read is None and (columns := columns_of(thing, where)) is not None:
        return points_from(columns, where)
    try:
        xyz, values = read(thing) if read else (thing, {})
        masked = masked_in(xyz) is not None
        xyz = np.ma.array(xyz, dtype=np.float64) if masked else np.array(plain_array(xyz), np.float64)
        if xyz.ndim == 0:  # None, or one number
            raise TypeError
    except (AttributeError, KeyError, RuntimeError, TypeError, ValueError):
        raise InputError(
            f"{where}: an object of type {_class_name(thing)} holds no points: must be {CLOUDS}"
        ) from None
    if xyz.ndim != 2 or xyz.shape[1] not in (2, 3):
        raise InputError(f"{where}: have shape {xyz.shape}: must be (n, 3), or (n, 2) in the plane")
    clash = sorted(set("xyz") & values.keys())
    if clash:
        raise InputError(f"{where}: values per point are named '{clash[0]}', as a coordinate is; rename them")
    return points_from({**dict(zip("xyz", xyz.T, strict=False)), **flatten_fields(values)}, where)


def _find_reader(readers: Mapping[str, Callable[..., Any]], thing: Any) -> Callable[..., Any] | None:
    """Return the reader of an object's class, or of a class that it derives from."""
    kinds = (f"{kind.__module__.partition('.')[0]}.{kind.__name__}" for kind in type(thing).__mro__)
    return next((readers[kind] for kind in kinds if kind in readers), None)


def _class_name(thing: Any) -> str:
    return f"{type(thing).__module__}.{type(thing).__name__}"
