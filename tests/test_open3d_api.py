"""`o3dls.register`: Open3D objects in and out, legacy and tensor, with the names that Open3D users know."""

from __future__ import annotations

from typing import Any

import numpy as np
import open3d as o3d
import pytest
from tiny import SHIFT, Nudge, ball_case

import o3dls
from o3dls.errors import InputError, PipelineError
from o3dls.geometry.similarity import similarity
from o3dls.stages.icp import ICP

RIGID = ICP(preset="standard")
CLOSE = 0.2  # mm; the points lie on a true sphere, the prior is a polyhedron


def objects(kind: str) -> tuple[Any, Any]:
    case = ball_case(points=300)
    vertices = o3d.utility.Vector3dVector(case.prior.vertices)
    triangles = o3d.utility.Vector3iVector(case.prior.faces.astype(np.int32))
    mesh = o3d.geometry.TriangleMesh(vertices, triangles)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(case.points.of("eam").xyz))
    if kind == "legacy":
        return mesh, cloud
    return o3d.t.geometry.TriangleMesh.from_legacy(mesh), o3d.t.geometry.PointCloud.from_legacy(cloud)


@pytest.mark.parametrize("kind", ["legacy", "tensor"])
def test_a_mesh_and_a_cloud_give_a_pose_and_a_mesh_of_the_same_kind(kind: str) -> None:
    mesh, cloud = objects(kind)
    found = o3dls.register(mesh, cloud, stages=[RIGID])
    np.testing.assert_allclose(found.transformation[:3, 3], SHIFT, atol=CLOSE)
    assert type(found.surface) is type(mesh)
    centre = np.asarray(
        found.surface.get_center() if kind == "legacy" else found.surface.get_center().numpy()
    )
    np.testing.assert_allclose(centre, SHIFT, atol=CLOSE)
    assert 0.9 < found.fitness <= 1.0
    assert 0.0 < found.inlier_rmse < CLOSE
    assert found.estimate is found.run.estimates["icp"]


def test_the_inputs_are_left_as_they_were() -> None:
    mesh, cloud = objects("legacy")
    before = np.asarray(mesh.vertices).copy(), np.asarray(cloud.points).copy()
    o3dls.register(mesh, cloud, stages=[Nudge()])
    np.testing.assert_array_equal(np.asarray(mesh.vertices), before[0])
    np.testing.assert_array_equal(np.asarray(cloud.points), before[1])


def test_fitness_counts_points_within_the_given_distance() -> None:
    mesh, cloud = objects("legacy")
    assert o3dls.register(mesh, cloud, stages=[RIGID], max_correspondence_distance=1e-9).fitness == 0.0
    assert o3dls.register(mesh, cloud, stages=[RIGID], max_correspondence_distance=100.0).fitness == 1.0


def test_landmarks_and_init_set_the_start() -> None:
    mesh, cloud = objects("legacy")
    axes = {name: (20.0 * axis, 20.0 * axis + SHIFT) for name, axis in zip("abc", np.eye(3), strict=True)}
    by_marks = o3dls.register(mesh, cloud, landmarks=axes, stages=[Nudge(share=0.0)])
    by_init = o3dls.register(mesh, cloud, init=similarity(np.eye(3), SHIFT), stages=[Nudge(share=0.0)])
    for found in (by_marks, by_init):
        np.testing.assert_allclose(found.transformation, similarity(np.eye(3), SHIFT), atol=1e-9)


def test_metres_are_refused() -> None:
    mesh, cloud = (thing.scale(1e-3, np.zeros(3)) for thing in objects("legacy"))
    with pytest.raises(InputError, match=r"prior: extends over 0.0\d+ mm; if its units are m, say units='m'"):
        o3dls.register(mesh, cloud, stages=[Nudge()])


def test_what_open3d_hides_is_refused() -> None:
    mesh, cloud = objects("legacy")
    with pytest.raises(InputError, match="no triangles; Open3D gives such a mesh"):
        o3dls.register(o3d.geometry.TriangleMesh(), cloud)
    with pytest.raises(InputError, match="points: the cloud has none"):
        o3dls.register(mesh, o3d.geometry.PointCloud(), stages=[Nudge()])
    bad = o3d.geometry.PointCloud(o3d.utility.Vector3dVector([[np.nan, 0, 0]] * 20))
    with pytest.raises(InputError, match="20 points are not finite"):
        o3dls.register(mesh, bad)
    mesh.remove_triangles_by_index([0])
    with pytest.raises(InputError, match="is open"):
        o3dls.register(mesh, cloud)
    with pytest.raises(PipelineError, match="no stage"):
        o3dls.register(objects("legacy")[0], cloud, stages=[])
    with pytest.raises(PipelineError, match=r"stages: .* is none: give a list of them, such as \[ICP\(\)\]"):
        o3dls.register(objects("legacy")[0], cloud, stages=[Nudge])


def test_arguments_of_another_kind_are_refused_in_words() -> None:
    mesh, cloud = objects("legacy")
    shear = np.eye(4)
    shear[0, 1] = 0.7
    for arguments, options, sentence in (
        (
            (cloud, mesh),
            {},
            "prior: an object of type .*PointCloud is not a surface: must be a mesh of Open3D",
        ),
        ((mesh, mesh), {}, "points: an object of type .*TriangleMesh holds no points: must be a cloud of"),
        ((mesh, "points.csv"), {}, "points: an object of type builtins.str holds no points"),
        ((mesh, cloud), {"init": np.eye(3)}, "init is not a pose"),
        ((mesh, cloud), {"init": shear}, "init is not a pose"),
        ((mesh, cloud), {"max_correspondence_distance": np.nan}, "must be above 0"),
        (
            (mesh, cloud),
            {"landmarks": {"LSPV": ([0.0, 0.0], [0.0, 0.0, 0.0])}},
            "'LSPV' on the prior is .*: must be 3 finite numbers",
        ),
    ):
        with pytest.raises(InputError, match=sentence):
            o3dls.register(*arguments, stages=[Nudge()], **options)


def test_a_mesh_comes_back_in_the_precision_it_came_in() -> None:
    mesh, cloud = objects("tensor")
    for kind in (o3d.core.float32, o3d.core.float64):
        mesh.vertex.positions = mesh.vertex.positions.to(kind)
        assert o3dls.register(mesh, cloud, stages=[Nudge()]).surface.vertex.positions.dtype == kind
