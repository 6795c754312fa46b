"""Meshes and clouds of Open3D, trimesh, pyvista and vtk, and meshio: each read to arrays, and made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface
from ..io.meshes.triangulation import triangulate
from .arrays import plain_array

Values = dict[str, NDArray[Any]]
Parts = tuple[Array, NDArray[Any], Values, Values]  # vertices, faces, values per vertex and per face
NO_FIELDS = ("positions", "indices", "normals", "colors")  # what Open3D keeps beside values
FLAT = ("triangle", "quad", "polygon")  # cells of meshio without an inside
VOLUMES = ("tetra", "hexahedron", "wedge", "pyramid")  # cells of meshio that have an inside


def to_open3d(surface: Surface) -> Any:
    """Return an `open3d.t.geometry.TriangleMesh` with float64 positions and every field as a vertex
    attribute; `.to_legacy()` drops those.
    """
    import open3d as o3d

    surface = _copy_surface(surface)
    tensor = o3d.core.Tensor.from_numpy
    mesh = o3d.t.geometry.TriangleMesh(tensor(surface.vertices), tensor(surface.faces))
    for name, values in surface.fields.items():
        mesh.vertex[name] = tensor(np.ascontiguousarray(values.reshape(len(values), -1)))
    return mesh


def open3d_like(surface: Surface, other: Any) -> Any:
    """Return an Open3D mesh with normals: of the precision of another one of the tensor interface, else
    legacy.
    """
    import open3d as o3d

    mesh = to_open3d(Surface(surface.vertices, surface.faces)).to_legacy()
    mesh.compute_vertex_normals()
    if not isinstance(other, o3d.t.geometry.TriangleMesh):
        return mesh
    return o3d.t.geometry.TriangleMesh.from_legacy(
        mesh, other.vertex.positions.dtype, other.triangle.indices.dtype
    )


def to_trimesh(surface: Surface) -> Any:
    """Return a `trimesh.Trimesh` that keeps the vertices' order; fields are its vertex attributes."""
    import trimesh

    surface = _copy_surface(surface)
    return trimesh.Trimesh(
        surface.vertices, surface.faces, process=False, vertex_attributes=dict(surface.fields)
    )


def to_pyvista(surface: Surface) -> Any:
    """Return a `pyvista.PolyData` with the fields as point data. Raises InputError where pyvista is not
    installed.
    """
    pyvista = _import_library("pyvista")
    surface = _copy_surface(surface)
    mesh = pyvista.PolyData(
        surface.vertices, np.column_stack([np.full(len(surface.faces), 3), surface.faces]).ravel()
    )
    for name, values in surface.fields.items():
        mesh.point_data[name] = values
    return mesh


def to_meshio(surface: Surface) -> Any:
    """Return a `meshio.Mesh` of triangles with the fields as point data. Raises InputError where meshio is
    not installed.
    """
    meshio = _import_library("meshio")
    surface = _copy_surface(surface)
    return meshio.Mesh(surface.vertices, [("triangle", surface.faces)], point_data=dict(surface.fields))


def _import_library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise InputError(f"{name} is not installed: pip install {name}") from error


def _copy_surface(surface: Surface) -> Surface:
    """Return a copy of the surface in memory of its own: the libraries share what they are given, and a mesh
    is there to be edited. InputError in 2D.
    """
    if surface.dimension != 3:
        raise InputError("mesh objects of Open3D, trimesh, pyvista and meshio are 3D; this surface is 2D")
    return Surface(
        surface.vertices.copy(),
        surface.faces.copy(),
        {name: np.array(values) for name, values in surface.fields.items()},
    )


def _is_tensor(thing: Any) -> bool:
    """Return whether an Open3D object is one of the tensor interface."""
    return ".t." in type(thing).__module__


def _from_open3d(mesh: Any, where: str) -> Parts:
    hint = "; Open3D gives such a mesh where it could not read a file"
    if _is_tensor(mesh):
        if "positions" not in mesh.vertex or "indices" not in mesh.triangle:
            raise InputError(f"{where}: the mesh is empty: has no vertex positions or no triangles{hint}")
        vertices, faces = plain_array(mesh.vertex.positions), plain_array(mesh.triangle.indices)
        return vertices, faces, _read_values(mesh.vertex), _read_values(mesh.triangle)
    if len(mesh.triangles) == 0:
        raise InputError(f"{where}: the mesh is empty: {len(mesh.vertices)} vertices, no triangles{hint}")
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles), {}, {}


def _read_values(attributes: Any) -> dict[str, NDArray[Any]]:
    """Read values per vertex or per face of a tensor object; a column of them is flat."""
    arrays = {name: plain_array(attributes[name]) for name in attributes if name not in NO_FIELDS}
    return {
        name: values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
        for name, values in arrays.items()
    }


def _from_trimesh(mesh: Any, where: str) -> Parts:
    on_points, on_faces = dict(mesh.vertex_attributes), dict(mesh.face_attributes)
    on_faces = {
        name: one for name, one in on_faces.items() if len(one) == len(mesh.faces)
    }  # trimesh does not check their length
    return np.asarray(mesh.vertices), np.asarray(mesh.faces), on_points, on_faces


def _from_scene(scene: Any, where: str) -> Parts:
    """Read the one mesh of a scene, as `trimesh.load` returns it, where it stands in the scene."""
    return _from_trimesh(_only_geometry(scene, where, "Trimesh"), where)


def _only_geometry(scene: Any, where: str, *kinds: str) -> Any:
    placed = [one for one in scene.dump() if type(one).__name__ in kinds]
    if len(placed) != 1:
        raise InputError(
            f"{where}: the scene holds {len(placed)} geometries of type {' or '.join(kinds)}: must be one; "
            f"give one of scene.geometry: {', '.join(map(str, scene.geometry)) or 'it is empty'}"
        )
    return placed[0]


def _from_vtk(mesh: Any, where: str) -> Parts:
    """Read a vtkPolyData, as pyvista's is too; polygons and strips become triangles."""
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter

    if mesh.GetNumberOfPolys() + mesh.GetNumberOfStrips() == 0:
        raise InputError(
            f"{where}: has {mesh.GetNumberOfPoints()} points and no polygons: a surface needs both"
        )
    triangles = vtkTriangleFilter()
    triangles.SetInputData(mesh)
    triangles.PassVertsOff()
    triangles.PassLinesOff()
    triangles.Update()
    made = triangles.GetOutput()
    faces = _vtk_array(made.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    on_points, on_faces = _vtk_values(mesh.GetPointData()), _vtk_values(made.GetCellData())
    return _vtk_array(mesh.GetPoints().GetData()), faces, on_points, on_faces


def _vtk_array(array: Any) -> NDArray[Any]:
    numpy_support: Any = import_module("vtkmodules.util.numpy_support")
    return np.asarray(numpy_support.vtk_to_numpy(array))


def _vtk_values(data: Any) -> Values:
    """Return numbers and words of the points or of the cells, without normals."""
    found = {}
    for k in range(data.GetNumberOfArrays()):
        array = data.GetAbstractArray(k)
        name = array.GetName()
        if data.GetArray(k) is not None and name not in (None, "Normals"):
            found[name] = _vtk_array(array)
        elif array.IsA("vtkStringArray") and name:
            found[name] = np.array([array.GetValue(i) for i in range(array.GetNumberOfValues())])
    return found


def _from_meshio(mesh: Any, where: str) -> Parts:
    kinds = {block.type for block in mesh.cells}
    if inside := sorted(kind for kind in kinds if kind.startswith(VOLUMES)):
        raise InputError(
            f"{where}: is a volume mesh with cells of {inside[0]}: give its surface, of triangles"
        )
    flat = [block.data for block in mesh.cells if block.type in FLAT]
    if not flat:
        raise InputError(
            f"{where}: has cells of {', '.join(sorted(kinds)) or 'no kind'}: must be triangles or quads"
        )
    vertices = np.asarray(mesh.points, dtype=np.float64)
    triangles, owner = triangulate(vertices, *map(np.asarray, flat))
    kept = [k for k, block in enumerate(mesh.cells) if block.type in FLAT]
    on_faces = {
        name: np.concatenate([np.asarray(blocks[k]) for k in kept])[owner]
        for name, blocks in mesh.cell_data.items()
    }
    return vertices, triangles, dict(mesh.point_data), on_faces


# by the package and the class
MESHES: Mapping[str, Callable[[Any, str], Parts]] = {
    "open3d.TriangleMesh": _from_open3d,
    "trimesh.Trimesh": _from_trimesh,
    "trimesh.Scene": _from_scene,
    "vtkmodules.vtkPolyData": _from_vtk,
    "meshio.Mesh": _from_meshio,
}
# positions and values per point
POINT_READERS: Mapping[str, Callable[[Any], tuple[Any, dict[str, Any]]]] = {
    "open3d.PointCloud": lambda cloud: (
        (plain_array(cloud.point.positions), _read_values(cloud.point))
        if _is_tensor(cloud)
        else (cloud.points, {})
    ),
    "trimesh.Scene": lambda scene: _scene_points(scene),
    "trimesh.PointCloud": lambda cloud: (cloud.vertices, {}),
    "trimesh.Path": lambda path: (path.vertices, {}),
    "trimesh.Trimesh": lambda mesh: (mesh.vertices, dict(mesh.vertex_attributes)),
    "vtkmodules.vtkPointSet": lambda cloud: (_vtk_positions(cloud), _vtk_values(cloud.GetPointData())),
    "meshio.Mesh": lambda mesh: (mesh.points, dict(mesh.point_data)),
}


def _scene_points(scene: Any) -> tuple[Any, dict[str, Any]]:
    one = _only_geometry(scene, "points", "PointCloud", "Trimesh")
    return one.vertices, dict(getattr(one, "vertex_attributes", {}))


def _vtk_positions(cloud: Any) -> Array:
    points = cloud.GetPoints()
    return np.zeros((0, 3)) if points is None else _vtk_array(points.GetData())
