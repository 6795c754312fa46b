"""Surface reconstruction from points alone, by the systems that the paper relates to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface

CELL = 2.0  # mm between nodes of a lattice
NEIGHBOURS = 12


def neighbours(points: Array) -> int:
    """Say how many points make a tangent plane: enough to be wider than the noise where points are dense."""
    return max(NEIGHBOURS, len(points) // 300)


def _make_cloud(points: Array) -> Any:
    """Make an Open3D cloud with oriented normals."""
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    around = neighbours(points)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(around))
    cloud.orient_normals_consistent_tangent_plane(around)
    normals = np.asarray(cloud.normals)
    if ((points - points.mean(axis=0)) * normals).sum() < 0.0:
        cloud.normals = o3d.utility.Vector3dVector(-normals)
    return cloud


def _make_surface(mesh: Any) -> Surface:
    if len(mesh.triangles) == 0:
        raise InputError("no surface")
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles))


def poisson(points: Array) -> Surface:
    """Reconstruct by screened Poisson (Kazhdan 2013) in Open3D."""
    import open3d as o3d

    return _make_surface(
        o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(_make_cloud(points), depth=6, n_threads=1)[
            0
        ]
    )


def alpha_shape(points: Array) -> Surface:
    """Make the alpha shape in Open3D, its radius three times the points' distance."""
    import open3d as o3d

    spacing = _measure_spacing(points)
    return _make_surface(
        o3d.geometry.TriangleMesh.create_from_point_cloud_alpha_shape(
            o3d.geometry.PointCloud(_make_cloud(points)), 3.0 * spacing
        )
    )


def _measure_spacing(points: Array) -> float:
    """Measure how far apart points lie: the median distance of the sixth neighbour."""
    from scipy.spatial import cKDTree

    return float(np.median(np.asarray(cKDTree(points).query(points, k=7)[0])[:, -1]))


def _make_lattice(points: Array) -> tuple[Array, list[Array]]:
    """Make nodes (k, 3) and axes of a lattice about the points."""
    axes = [
        np.arange(low - 5 * CELL, high + 6 * CELL, CELL)
        for low, high in zip(points.min(axis=0), points.max(axis=0), strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), axes


def _zero_set(phi: Array, axes: list[Array]) -> Surface:
    import open3d as o3d

    if not (phi < 0.0).any():
        raise InputError("no surface: the level set vanished")
    mesh = o3d.t.geometry.TriangleMesh.create_isosurfaces(
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(phi.T.astype(np.float32))), [0.0]
    )
    faces = mesh.triangle.indices.numpy()[:, ::-1].astype(np.int64)
    if len(faces) == 0:
        raise InputError("no surface: the level set does not change its sign")
    return Surface(
        mesh.vertex.positions.numpy().astype(np.float64) * CELL + [axis[0] for axis in axes], faces
    )


def tangent_planes(points: Array) -> Surface:
    """Find the zero set of the signed distance to the nearest neighbourhood's tangent plane (Hoppe 1992).

    Kept where a point is near.
    """
    from scipy.spatial import cKDTree

    nodes, axes = _make_lattice(points)
    normals = np.asarray(_make_cloud(points).normals)
    middles = points[cKDTree(points).query(points, k=neighbours(points))[1]].mean(axis=1)
    nearest = cKDTree(middles).query(nodes)[1]
    signed = ((nodes - middles[nearest]) * normals[nearest]).sum(axis=1)
    found = _zero_set(signed.reshape([len(axis) for axis in axes]), axes)
    known = np.asarray(cKDTree(points).query(found.vertices)[0]) < 2.0 * _measure_spacing(points) + CELL
    return Surface(found.vertices, found.faces[known[found.faces].all(axis=1)])


def minimal_surface(points: Array) -> Surface:
    """Minimise the integral of the distance d over the surface (Zhao 2000).

    phi_t = |grad phi| (d kappa) + grad d . grad phi, from outside of the points inward, and half as far again
    as the points lie: its only global minimum is the empty surface.
    """
    from scipy.ndimage import distance_transform_edt
    from scipy.spatial import cKDTree

    nodes, axes = _make_lattice(points)
    shape = [len(axis) for axis in axes]
    d = np.asarray(cKDTree(points).query(nodes)[0]).reshape(shape)
    slope = np.gradient(d, CELL)
    outside = max(1.5 * _measure_spacing(points), 2.0 * CELL)
    phi = _fill_cavities(d - outside, distance_transform_edt)
    dt = 0.2 * CELL / max(1.0, float(np.percentile(d, 95)) / CELL)
    for step in range(int(1.5 * outside / dt)):
        g = np.gradient(phi, CELL)
        size = np.sqrt(sum(a * a for a in g)) + 1e-6
        bend = sum(np.gradient(a / size, CELL, axis=k) for k, a in enumerate(g))
        phi = phi + dt * (
            d * np.clip(bend, -1.0 / CELL, 1.0 / CELL) * size
            + sum(a * b for a, b in zip(slope, g, strict=True))
        )
        if step % 10 == 9:
            phi = _fill_cavities(phi, distance_transform_edt)
    return _zero_set(phi, axes)


def _fill_cavities(phi: Array, edt: Callable[..., Any]) -> Array:
    """Compute the signed distance of the outer boundary of phi < 0.

    Cavities that nothing reaches from outside are inside.
    """
    from scipy.ndimage import binary_fill_holes

    inside = binary_fill_holes(phi < 0.0)
    near = np.abs(phi) < CELL
    coarse = CELL * (edt(~inside) - edt(inside) + np.where(inside, 0.5, -0.5))
    return np.where(near & ((phi < 0.0) == inside), phi, coarse)
