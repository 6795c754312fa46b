"""Steps of ICP by Open3D's own estimators, for comparisons that must rest on them; matching and rejection stay ours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .geometry import Array
from .registration.robust import EFFICIENT_95, spread

if TYPE_CHECKING:
    from .registration.icp import Solver
    from .registration.metrics import Factors
    from .registration.step import Body, Freedom

KERNELS = ("none", "huber", "cauchy", "geman_mcclure", "tukey")


def open3d_solver(metric: str, kernel: str, width: float | None, point_normals: Array, thickness: float) -> Solver:
    """A solver for `align`: metric as in the stage `icp`, kernel among KERNELS, normals (n, 3) of the points where the metric needs
    them. Estimators other than point_to_point move the points, as Open3D knows normals of the target; the motion is then inverted."""

    def solve(factors: Factors, weights: Array, body: Body, freedom: Freedom, share: float) -> Array:
        import open3d as o3d

        registration, kept, pairs = o3d.pipelines.registration, np.flatnonzero(weights > 0.0), factors.pairs
        rows = o3d.utility.Vector2iVector(np.column_stack([np.arange(len(kept))] * 2).astype(np.int32))
        surface = _cloud(o3d, pairs.feet[kept], pairs.normals[kept], thickness)
        if metric == "point_to_point":
            points = _cloud(o3d, pairs.points[kept], None, thickness)
            estimator = registration.TransformationEstimationPointToPoint(freedom.scale)
            return np.asarray(estimator.compute_transformation(surface, points, rows), dtype=np.float64)
        towards = None
        if len(point_normals):
            along = (point_normals * pairs.normals).sum(axis=1, keepdims=True) >= 0.0
            towards = np.where(along, point_normals, -point_normals)[kept]
        loss = _loss(registration, kernel, (EFFICIENT_95.get(kernel, 1.0) if width is None else width) * spread(factors.residuals[kept]))
        estimator = _estimator(registration, metric, loss, thickness)
        matrix = estimator.compute_transformation(_cloud(o3d, pairs.points[kept], towards, thickness), surface, rows)
        return np.asarray(np.linalg.inv(matrix), dtype=np.float64)

    return solve


def _cloud(o3d: Any, points: Array, normals: Array | None, thickness: float) -> Any:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        cloud.normals = o3d.utility.Vector3dVector(normals)
        flat = np.eye(3) - (1.0 - thickness) * normals[:, :, None] * normals[:, None, :]
        cloud.covariances = o3d.utility.Matrix3dVector(flat)
    return cloud


def _loss(registration: Any, kernel: str, width: float) -> Any:
    width = max(width, 1e-9)
    if kernel == "geman_mcclure":
        return registration.GMLoss(width**2)  # Open3D writes k / (k + r^2)^2
    losses = {"huber": registration.HuberLoss, "cauchy": registration.CauchyLoss, "tukey": registration.TukeyLoss}
    return losses[kernel](width) if kernel in losses else registration.L2Loss()


def _estimator(registration: Any, metric: str, loss: Any, thickness: float) -> Any:
    if metric == "generalized":
        return registration.TransformationEstimationForGeneralizedICP(thickness, loss)
    if metric == "symmetric":
        return registration.TransformationEstimationSymmetric(loss)
    return registration.TransformationEstimationPointToPlane(loss)
