"""Surfaces and points as objects of Open3D, trimesh and pyvista, and back; per-vertex fields travel where the library keeps them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry import Array, Surface


def to_open3d(surface: Surface) -> Any:
    """An `open3d.t.geometry.TriangleMesh` with float64 positions and every field as a vertex attribute; `.to_legacy()` drops those."""
    import open3d as o3d

    _in_3d(surface)
    tensor = o3d.core.Tensor.from_numpy
    mesh = o3d.t.geometry.TriangleMesh(tensor(surface.vertices), tensor(surface.faces))
    for name, values in surface.fields.items():
        mesh.vertex[name] = tensor(np.ascontiguousarray(values.reshape(len(values), -1)))
    return mesh


def to_trimesh(surface: Surface) -> Any:
    """A `trimesh.Trimesh` that keeps the vertices' order; fields are its vertex attributes."""
    import trimesh

    _in_3d(surface)
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False, vertex_attributes=dict(surface.fields))


def to_pyvista(surface: Surface) -> Any:
    """A `pyvista.PolyData` with the fields as point data. Raises InputError where pyvista is not installed."""
    try:
        import pyvista
    except ImportError as error:
        raise InputError("pyvista is not installed: pip install pyvista") from error
    _in_3d(surface)
    mesh = pyvista.PolyData(surface.vertices, np.column_stack([np.full(len(surface.faces), 3), surface.faces]).ravel())
    for name, values in surface.fields.items():
        mesh.point_data[name] = values
    return mesh


def _in_3d(surface: Surface) -> None:
    if surface.dimension != 3:
        raise InputError("mesh objects of Open3D, trimesh and pyvista are 3D; this surface is 2D")


def surface_of(mesh: Any) -> Surface:
    """The surface of an Open3D mesh (legacy or tensor), a trimesh or a pyvista PolyData. Raises InputError for anything else."""
    library = type(mesh).__module__.partition(".")[0]
    if library not in READERS:
        raise InputError(f"an object of type {type(mesh).__module__}.{type(mesh).__name__} is no mesh of {', '.join(READERS)}")
    return READERS[library](mesh)


def points_of(cloud: Any) -> Array:
    """Positions (n, 3) of an Open3D point cloud (legacy or tensor), a trimesh or pyvista object, or an array. Raises InputError."""
    read = POINT_READERS.get(type(cloud).__module__.partition(".")[0], np.array)
    xyz = np.array(read(cloud), dtype=np.float64)
    if xyz.ndim != 2 or xyz.shape[1] not in (2, 3):
        raise InputError(f"points have shape {xyz.shape}: must be (n, 3), or (n, 2) in the plane")
    return xyz


def _tensor(thing: Any) -> bool:
    """Whether an Open3D object is one of the tensor interface."""
    return ".t." in type(thing).__module__


def _from_open3d(mesh: Any) -> Surface:
    if not _tensor(mesh):  # copies: the arrays of a legacy mesh end with it
        return Surface(np.array(mesh.vertices), np.array(mesh.triangles))
    fields = {name: _flat(mesh.vertex[name].numpy()) for name in mesh.vertex if name not in ("positions", "normals", "colors")}
    return Surface(mesh.vertex.positions.numpy().copy(), mesh.triangle.indices.numpy().copy(), fields)


def _from_trimesh(mesh: Any) -> Surface:
    return Surface(
        np.array(mesh.vertices), np.array(mesh.faces), {k: np.asarray(v, dtype=float) for k, v in mesh.vertex_attributes.items()}
    )


def _from_pyvista(mesh: Any) -> Surface:
    cells = np.asarray(mesh.faces)
    if mesh.n_strips or len(cells) % 4 or (cells[::4] != 3).any():
        mesh = mesh.triangulate()
        cells = np.asarray(mesh.faces)
    fields = {name: np.asarray(mesh.point_data[name], dtype=float) for name in mesh.point_data.keys() if name != "Normals"}  # noqa: SIM118  # no mapping
    return Surface(np.asarray(mesh.points), cells.reshape(-1, 4)[:, 1:], fields)


def _flat(values: Any) -> Array:
    return np.array(values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values, dtype=np.float64)


READERS: Mapping[str, Callable[[Any], Surface]] = {"open3d": _from_open3d, "trimesh": _from_trimesh, "pyvista": _from_pyvista}
POINT_READERS: Mapping[str, Callable[[Any], Any]] = {
    "open3d": lambda cloud: cloud.point.positions.numpy() if _tensor(cloud) else cloud.points,
    "trimesh": lambda cloud: cloud.vertices,
    "pyvista": lambda cloud: cloud.points,
}
