"""Steps of ICP by Open3D's own estimators, for comparisons that must rest on them; matching and rejection
stay ours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..geometry.similarity import apply, scale_of
from ..noise.robust import EFFICIENT_95, robust_sd

if TYPE_CHECKING:
    from ..registration.icp import Solver
    from ..registration.match import Pairs
    from ..registration.metrics import Factors
    from ..registration.step import Body, Freedom

KERNELS = ("none", "huber", "cauchy", "geman_mcclure", "tukey")


def open3d_solver(
    metric: str, kernel: str, width: float | None, point_normals: Array, thickness: float
) -> Solver:
    """Return a solver for `align`: metric as in the stage `icp`, kernel among KERNELS, `width` in robust
    standard deviations (None: 95 % efficient), normals (n, 3) of the points where the metric needs them, else
    none (0, 3).
    """

    def solve(factors: Factors, weights: Array, body: Body, freedom: Freedom, share: float) -> Array:
        kept = np.flatnonzero(weights > 0.0)
        if metric == "point_to_point":
            return _step_to_points(factors.pairs.points[kept], factors.pairs.feet[kept], scale=freedom.scale)
        factor = EFFICIENT_95.get(kernel, 1.0) if width is None else width
        normals = point_normals[kept] if len(point_normals) else point_normals
        shrink = scale_of(np.asarray(np.linalg.inv(body.T_map_prior)))
        width_here = factor * robust_sd(factors.residuals[kept]) * shrink
        estimator = _make_estimator(metric, kernel, width_here, thickness)
        return _step_on_normals(estimator, factors.pairs.of(kept), normals, thickness, body.T_map_prior)

    return solve


def _step_to_points(points: Array, feet: Array, *, scale: bool) -> Array:
    import open3d as o3d

    estimator = o3d.pipelines.registration.TransformationEstimationPointToPoint(scale)
    return np.asarray(
        estimator.compute_transformation(
            _make_cloud(feet), _make_cloud(points), _pair_one_to_one(len(points))
        ),
        dtype=np.float64,
    )


def _step_on_normals(
    estimator: Any, pairs: Pairs, point_normals: Array, thickness: float, T_map_prior: Array
) -> Array:
    """Return an estimator's step along normals: Open3D moves the points onto a surface at rest and turns them
    about the origin, so its steps are taken in the frame of the prior.
    """
    prior_map = np.asarray(np.linalg.inv(T_map_prior))
    turn = prior_map[:3, :3] / scale_of(prior_map)
    normals = pairs.normals @ turn.T
    surface = _make_cloud(apply(prior_map, pairs.feet), normals, thickness)
    points = _make_cloud(apply(prior_map, pairs.points))
    if len(point_normals):
        points = _make_cloud(apply(prior_map, pairs.points), point_normals @ turn.T, thickness)
    matrix = estimator.compute_transformation(points, surface, _pair_one_to_one(len(normals)))
    return np.asarray(T_map_prior @ np.linalg.inv(matrix) @ prior_map, dtype=np.float64)


def _make_estimator(metric: str, kernel: str, width: float, thickness: float) -> Any:
    """Make Open3D's estimator of a metric along normals, whose loss has this width in the prior's frame."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    if metric == "generalized":
        return registration.TransformationEstimationForGeneralizedICP(thickness, _make_loss(kernel, width))
    if metric == "symmetric":  # its residual is along the sum of the normals, ours along their mean
        return registration.TransformationEstimationSymmetric(_make_loss(kernel, 2.0 * width))
    return registration.TransformationEstimationPointToPlane(_make_loss(kernel, width))


def _pair_one_to_one(count: int) -> Any:
    import open3d as o3d

    return o3d.utility.Vector2iVector(np.column_stack([np.arange(count)] * 2).astype(np.int32))


def _make_cloud(points: Array, normals: Array | None = None, thickness: float = 1.0) -> Any:
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        cloud.normals = o3d.utility.Vector3dVector(normals)
        cloud.covariances = o3d.utility.Matrix3dVector(
            np.eye(3) - (1.0 - thickness) * normals[:, :, None] * normals[:, None, :]
        )
    return cloud


def _make_loss(kernel: str, width: float) -> Any:
    import open3d as o3d

    registration = o3d.pipelines.registration
    width = max(width, 1e-9)
    if kernel == "geman_mcclure":
        return registration.GMLoss(width**2)  # Open3D writes k / (k + r^2)^2
    losses = {
        "huber": registration.HuberLoss,
        "cauchy": registration.CauchyLoss,
        "tukey": registration.TukeyLoss,
    }
    return losses[kernel](width) if kernel in losses else registration.L2Loss()
