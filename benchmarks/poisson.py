"""Screened Poisson reconstruction: what the points alone tell."""

from __future__ import annotations

import numpy as np

from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.geometry.closest_point import ClosestPoint
from o3dls.geometry.surface import Surface

FACES = 100  # fewer are no surface


def poisson(case: Case, pose: Array, *, depth: int, neighbours: int) -> Surface:
    """Open3D's screened Poisson reconstruction of the points alone, untrimmed; normals by the plane through
    the nearest points, turned to the side that the prior at its closest point looks to. Raises ValueError
    where nothing comes of it.
    """
    import open3d as o3d

    posed = case.prior.transformed(pose)
    points = case.points.of("eam").xyz
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(min(neighbours, len(points))))
    normals = np.asarray(cloud.normals)
    _, face, _, _ = ClosestPoint(posed.vertices, posed.faces).query(points)
    sides = np.sign((normals * posed.face_normals[face]).sum(axis=1))
    cloud.normals = o3d.utility.Vector3dVector(np.where(sides == 0.0, 1.0, sides)[:, None] * normals)
    # one thread: with more, equal inputs do not give equal surfaces
    mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    if len(mesh.triangles) < FACES:
        raise ValueError(f"Poisson reconstruction gives {len(mesh.triangles)} faces")
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles)).without_unused()
