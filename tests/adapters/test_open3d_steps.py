"""Our ICP and Open3D's legacy ICP do the same to the points: step for step where the step is unique, at rest
where it is not.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from chamber import chamber, farthest_effect, measured, pose
from tiny import disc_case

from o3dls.adapters.open3d_steps import open3d_solver
from o3dls.arrays import Array
from o3dls.errors import InputError
from o3dls.estimate import Estimate
from o3dls.geometry.similarity import apply, scale_of
from o3dls.geometry.surface import Surface
from o3dls.registration import metrics
from o3dls.registration.icp import Criteria, Recipe, align
from o3dls.registration.match import Pairs, SurfaceMatcher
from o3dls.registration.normals import point_normals
from o3dls.registration.step import Body, Freedom, best_motion
from o3dls.stages.icp import ICP

PRIOR = chamber(30)
AGREE = 1e-6  # mm, effect of the pose on the points


class VertexMatcher(SurfaceMatcher):
    """Pairs points with vertices and their normals, as Open3D pairs clouds."""

    def match(self, points: Array, T_map_prior: Array, last: Pairs | None = None) -> Pairs:
        from scipy.spatial import cKDTree

        _, rows = cKDTree(self.surface.vertices).query(apply(np.linalg.inv(T_map_prior), points))
        normals = self.surface.vertex_normals[rows] @ T_map_prior[:3, :3].T / scale_of(T_map_prior)
        return Pairs(points, apply(T_map_prior, self.surface.vertices[rows]), normals, rows)


def legacy(points: Array, prior: Surface, steps: int, metric: str) -> Array:
    """T_map_prior of Open3D's registration_icp from the identity after a number of steps."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    source, target = (
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz)) for xyz in (points, prior.vertices)
    )
    target.normals = o3d.utility.Vector3dVector(prior.vertex_normals)
    estimator = (
        registration.TransformationEstimationPointToPlane()
        if metric == "point_to_plane"
        else registration.TransformationEstimationPointToPoint()
    )
    stop = registration.ICPConvergenceCriteria(relative_fitness=0.0, relative_rmse=0.0, max_iteration=steps)
    return np.linalg.inv(
        registration.registration_icp(source, target, 1e3, np.eye(4), estimator, stop).transformation
    )


def effect(a: Array, b: Array, points: Array) -> float:
    """Largest difference between where two poses of the prior put points in its frame."""
    return float(np.abs(apply(np.linalg.inv(a), points) - apply(np.linalg.inv(b), points)).max())


@pytest.mark.parametrize("steps", [1, 2, 5, 30])
@pytest.mark.parametrize("metric", ["point_to_point", "point_to_plane"])
def test_with_its_estimators_our_loop_is_open3ds_icp_step_for_step(metric: str, steps: int) -> None:
    points = measured(PRIOR, pose(6.0, 5.0), noise=1.0).points.of("eam").xyz
    solve = open3d_solver(metric, "none", None, points[:0], 1.0)
    recipe = Recipe(getattr(metrics, metric), Freedom(), solve=solve)
    ours = align(points, VertexMatcher(PRIOR), np.eye(4), recipe, Criteria(0.0, steps))
    assert effect(ours.T_map_prior, legacy(points, PRIOR, steps, metric), points) < AGREE


@pytest.mark.parametrize("steps", [1, 2, 5, 30])
def test_our_rigid_point_to_point_is_open3ds_icp_step_for_step(steps: int) -> None:
    points = measured(PRIOR, pose(6.0, 5.0), noise=1.0).points.of("eam").xyz
    recipe = Recipe(metrics.point_to_point, Freedom())
    ours = align(points, VertexMatcher(PRIOR), np.eye(4), recipe, Criteria(0.0, steps))
    assert effect(ours.T_map_prior, legacy(points, PRIOR, steps, "point_to_point"), points) < AGREE


@pytest.mark.parametrize(
    "given",
    [
        {"metric": "point_to_point"},
        {"metric": "point_to_point", "scale": True, "scale_sd": None},
        {"metric": "point_to_point", "reject": "trimmed"},
    ],
)
def test_closed_form_steps_of_both_engines_are_the_same(given: dict[str, object]) -> None:
    case = measured(PRIOR, pose(6.0, 5.0, 1.04), noise=1.0)
    start = Estimate(case.prior, np.eye(4), "start")
    ours, theirs = (
        ICP(preset="standard", engine=engine, iterations=7, **given)(case, start)
        for engine in ("o3dls", "open3d")
    )
    assert farthest_effect(ours.T_map_prior, theirs.T_map_prior, PRIOR) < AGREE


@pytest.mark.parametrize(
    ("metric", "kernel"),
    [
        ("generalized", "none"),
        *product(["point_to_plane", "symmetric"], ["none", "huber", "cauchy", "geman_mcclure", "tukey"]),
    ],
)
def test_both_engines_rest_at_the_same_pose_where_points_fit(metric: str, kernel: str) -> None:
    case = measured(PRIOR, pose(5.0, 4.0), 300, noise=0.3)
    start = Estimate(case.prior, np.eye(4), "start")
    shared = {
        "preset": "standard",
        "metric": metric,
        "kernel": kernel,
        "iterations": 200,
        "tolerance": 1e-10,
        "coarse": 1.0,
    }
    ours, theirs = (ICP(engine=engine, **shared)(case, start) for engine in ("o3dls", "open3d"))
    assert farthest_effect(ours.T_map_prior, theirs.T_map_prior, PRIOR) < AGREE


@pytest.mark.parametrize("metric", ["point_to_plane", "symmetric", "generalized"])
def test_on_the_same_pairs_both_take_the_same_step(metric: str) -> None:
    """The linear step: what Open3D makes of it by Euler angles about the origin, and we by a rotation vector
    about the feet, differs by its square, so it is compared where it is small.
    """
    points = measured(PRIOR, np.eye(4)).points.of("eam").xyz
    T = pose(1e-3, 1e-3)
    normals = point_normals(points) if metric != "point_to_plane" else points[:0]
    make = {
        "point_to_plane": metrics.point_to_plane,
        "symmetric": metrics.symmetric(normals),
        "generalized": metrics.generalized(normals),
    }
    pairs = SurfaceMatcher(PRIOR).match(points, T)
    body = Body.of(PRIOR.vertices).at(T)
    steps = [
        solve(make[metric](pairs), np.ones(len(points)), body, Freedom(), 1.0)
        for solve in (best_motion, open3d_solver(metric, "none", None, normals, 0.05))
    ]
    assert np.abs(apply(steps[0], pairs.feet) - pairs.feet).max() > 100 * AGREE
    assert np.abs(apply(steps[0], pairs.feet) - apply(steps[1], pairs.feet)).max() < AGREE


def test_open3d_is_for_three_dimensions() -> None:
    case = disc_case()
    stage = ICP(preset="standard", engine="open3d")
    assert "for 3D" in str(stage.obstacle(case))
    with pytest.raises(InputError, match="for 3D"):
        stage(case, Estimate(case.prior, np.eye(3), "start"))
