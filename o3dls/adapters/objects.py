"""Surfaces and points as objects of Open3D, trimesh and pyvista, and back; per-vertex fields travel where the
library keeps them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface


def to_open3d(surface: Surface) -> Any:
    """An `open3d.t.geometry.TriangleMesh` with float64 positions and every field as a vertex attribute;
    `.to_legacy()` drops those.
    """
    import open3d as o3d

    surface = _copied(surface)
    tensor = o3d.core.Tensor.from_numpy
    mesh = o3d.t.geometry.TriangleMesh(tensor(surface.vertices), tensor(surface.faces))
    for name, values in surface.fields.items():
        mesh.vertex[name] = tensor(np.ascontiguousarray(values.reshape(len(values), -1)))
    return mesh


def to_trimesh(surface: Surface) -> Any:
    """A `trimesh.Trimesh` that keeps the vertices' order; fields are its vertex attributes."""
    import trimesh

    surface = _copied(surface)
    return trimesh.Trimesh(
        surface.vertices, surface.faces, process=False, vertex_attributes=dict(surface.fields)
    )


def to_pyvista(surface: Surface) -> Any:
    """A `pyvista.PolyData` with the fields as point data. Raises InputError where pyvista is not
    installed.
    """
    try:
        import pyvista
    except ImportError as error:
        raise InputError("pyvista is not installed: pip install pyvista") from error
    surface = _copied(surface)
    mesh = pyvista.PolyData(
        surface.vertices, np.column_stack([np.full(len(surface.faces), 3), surface.faces]).ravel()
    )
    for name, values in surface.fields.items():
        mesh.point_data[name] = values
    return mesh


def _copied(surface: Surface) -> Surface:
    """The surface in memory of its own: the libraries share what they are given, and a mesh is there to be
    edited. InputError in 2D.
    """
    if surface.dimension != 3:
        raise InputError("mesh objects of Open3D, trimesh and pyvista are 3D; this surface is 2D")
    return Surface(
        surface.vertices.copy(),
        surface.faces.copy(),
        {name: np.array(values) for name, values in surface.fields.items()},
    )


def surface_of(mesh: Any) -> Surface:
    """The surface of an Open3D mesh (legacy or tensor), a trimesh or a pyvista PolyData. Raises InputError
    for anything else.
    """
    read = _reader(READERS, mesh)
    if read is None:
        raise InputError(f"an object of type {_kind(mesh)} is no mesh of {', '.join(READERS)}")
    return _copied(read(mesh))


def points_of(cloud: Any) -> Array:
    """Positions (n, 3) of an Open3D point cloud (legacy or tensor), a trimesh or pyvista object, or an array.
    Raises InputError.
    """
    try:
        xyz = np.array((_reader(POINT_READERS, cloud) or np.asarray)(cloud), dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        raise InputError(
            f"an object of type {_kind(cloud)} holds no points: must be of {', '.join(POINT_READERS)} or "
            "an array"
        ) from None
    if xyz.ndim != 2 or xyz.shape[1] not in (2, 3):
        raise InputError(f"points have shape {xyz.shape}: must be (n, 3), or (n, 2) in the plane")
    return xyz


def _reader(readers: Mapping[str, Callable[[Any], Any]], thing: Any) -> Callable[[Any], Any] | None:
    """The reader of an object's class, or of a class that it derives from."""
    kinds = (f"{kind.__module__.partition('.')[0]}.{kind.__name__}" for kind in type(thing).__mro__)
    return next((readers[kind] for kind in kinds if kind in readers), None)


def _kind(thing: Any) -> str:
    return f"{type(thing).__module__}.{type(thing).__name__}"


def _tensor(thing: Any) -> bool:
    """Whether an Open3D object is one of the tensor interface."""
    return ".t." in type(thing).__module__


def _from_open3d(mesh: Any) -> Surface:
    if not _tensor(mesh):
        return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles))
    if "positions" not in mesh.vertex or "indices" not in mesh.triangle:
        raise InputError("the Open3D mesh is empty: it must have vertex positions and triangle indices")
    fields = {
        name: _flat(mesh.vertex[name].numpy())
        for name in mesh.vertex
        if name not in ("positions", "normals", "colors")
    }
    return Surface(mesh.vertex.positions.numpy(), mesh.triangle.indices.numpy(), fields)


def _from_trimesh(mesh: Any) -> Surface:
    fields = {name: np.asarray(values, dtype=float) for name, values in mesh.vertex_attributes.items()}
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces), fields)


def _from_pyvista(mesh: Any) -> Surface:
    cells = np.asarray(mesh.faces)
    if mesh.n_strips or len(cells) % 4 or (cells[::4] != 3).any():
        mesh = mesh.triangulate()
        cells = np.asarray(mesh.faces)
    names = mesh.point_data.keys()  # point_data is no mapping: iterating over it gives arrays
    fields = {name: np.asarray(mesh.point_data[name], dtype=float) for name in names if name != "Normals"}
    return Surface(np.asarray(mesh.points), cells.reshape(-1, 4)[:, 1:], fields)


def _flat(values: Any) -> Array:
    return np.asarray(values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values, dtype=np.float64)


READERS: Mapping[str, Callable[[Any], Surface]] = {
    "open3d.TriangleMesh": _from_open3d,
    "trimesh.Trimesh": _from_trimesh,
    "pyvista.PolyData": _from_pyvista,
}
POINT_READERS: Mapping[str, Callable[[Any], Any]] = {
    "open3d.PointCloud": lambda cloud: cloud.point.positions.numpy() if _tensor(cloud) else cloud.points,
    "trimesh.PointCloud": lambda cloud: cloud.vertices,
    "trimesh.Path": lambda path: path.vertices,
    "trimesh.Trimesh": lambda mesh: mesh.vertices,
    "pyvista.DataSet": lambda cloud: cloud.points,
}
