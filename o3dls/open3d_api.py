"""Registration for people with Open3D objects: a mesh and a point cloud in, names like `RegistrationResult`
and a mesh out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array
from .case import Case, Points
from .errors import InputError
from .estimate import Estimate
from .evaluation.distances import distances
from .geometry.surface import Surface
from .noise.robust import robust_sd
from .runs.run import Run

if TYPE_CHECKING:
    import open3d as o3d

    from .plugins.stage import Stage

REACH = 3.0  # pairs within this many standard deviations of the noise count as inliers
SMALLEST = 1.0  # mm: no chamber of a heart is smaller


@dataclass(frozen=True, eq=False)
class Registration:
    """What `register` found.

    transformation (4, 4): the similarity part, prior to points; surface: the fused surface, an Open3D mesh of
    the kind that came in; fitness: share of the points within the correspondence distance of the surface;
    inlier_rmse: of those points; estimate and run: everything else, as in the rest of o3dls.
    """

    transformation: Array
    fitness: float
    inlier_rmse: float
    surface: Any
    estimate: Estimate
    run: Run


def register(
    prior: o3d.geometry.TriangleMesh | o3d.t.geometry.TriangleMesh,
    points: o3d.geometry.PointCloud | o3d.t.geometry.PointCloud,
    *,
    landmarks: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    init: ArrayLike | None = None,
    stages: Sequence[Stage] | None = None,
    max_correspondence_distance: float | None = None,
) -> Registration:
    """Fuse a closed prior mesh with measured points, both legacy or tensor objects, lengths in mm.

    landmarks: name -> (position on the prior, position among the points); init: rough pose (4, 4), prior to
    points; stages: default those of the default pipeline that the case allows; max_correspondence_distance:
    default three standard deviations of the noise found. Raises InputError for what cannot be registered,
    PipelineError for wrong stages.
    """
    from .pipeline.file import default_pipeline
    from .pipeline.pipeline import Pipeline

    if max_correspondence_distance is not None and not max_correspondence_distance > 0.0:
        raise InputError(f"max_correspondence_distance = {max_correspondence_distance} mm: must be above 0")
    case = _case(prior, points, landmarks or {}, init)
    pipeline = (
        Pipeline(stages, folds=0)
        if stages is not None
        else Pipeline(default_pipeline().stages, folds=0).allowed_by(case)
    )
    run = pipeline.run(case)
    estimate = run.estimates[run.final]
    gap = distances(run.case.points.of("eam").xyz, estimate.surface)
    noise = estimate.sigma or robust_sd(gap)
    near = gap <= (REACH * noise if max_correspondence_distance is None else max_correspondence_distance)
    return Registration(
        transformation=estimate.T_map_prior,
        fitness=float(near.mean()),
        inlier_rmse=float(np.sqrt((gap[near] ** 2).mean())) if near.any() else 0.0,
        surface=_mesh(estimate.surface, like=prior),
        estimate=estimate,
        run=run,
    )


def _case(
    prior: Any, points: Any, landmarks: Mapping[str, tuple[ArrayLike, ArrayLike]], init: ArrayLike | None
) -> Case:
    """Open3D objects as a case, checked as strictly as files are."""
    from .io.meshes.repair import closed_outward

    mesh, cloud = _legacy(prior, "prior", "TriangleMesh"), _legacy(points, "points", "PointCloud")
    if len(mesh.triangles) == 0:
        raise InputError(
            f"prior: {len(mesh.vertices)} vertices, no triangles; Open3D gives such a mesh where it "
            "could not read a file"
        )
    xyz = np.asarray(cloud.points, dtype=np.float64).copy()
    if not len(xyz):
        raise InputError(
            "points: the cloud has none; Open3D gives such a cloud where it could not read a file"
        )
    if not np.isfinite(xyz).all():
        raise InputError(
            f"points: {(~np.isfinite(xyz).all(axis=1)).sum()} points are not finite; remove them"
        )
    surface = closed_outward(
        Surface(np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles).copy()), "prior"
    )
    if surface.diagonal < SMALLEST:
        raise InputError(
            f"prior: extends over {surface.diagonal:.3g} mm, and an atrium over 60 to 160: lengths must "
            "be in mm"
        )
    marks = [_place(name, "among the points", to) for name, (_, to) in landmarks.items()]
    kinds = np.array(["eam"] * len(xyz) + ["landmark"] * len(marks))
    names = np.array([""] * len(xyz) + [str(name) for name in landmarks])
    return Case(
        name="open3d",
        prior=surface,
        points=Points(np.vstack([xyz, *marks]), kinds, {"name": names}),
        prior_landmarks={str(name): _place(name, "on the prior", at) for name, (at, _) in landmarks.items()},
        init=None if init is None else np.asarray(init, dtype=np.float64),
    )


def _place(name: str, where: str, at: ArrayLike) -> Array:
    place = np.asarray(at, dtype=np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InputError(f"landmarks: the position of '{name}' {where} is {at!r}: must be 3 finite numbers")
    return place


def _legacy(thing: Any, role: str, kind: str) -> Any:
    """The legacy twin of a tensor object; a legacy object is its own."""
    import open3d as o3d

    legacy = thing.to_legacy() if isinstance(thing, getattr(o3d.t.geometry, kind)) else thing
    if not isinstance(legacy, getattr(o3d.geometry, kind)):
        raise InputError(f"{role}: is {type(thing).__name__}: must be an Open3D {kind}")
    return legacy


def _mesh(surface: Surface, *, like: Any) -> Any:
    """An Open3D mesh of the same kind and precision as `like`, with normals."""
    import open3d as o3d

    vertices = o3d.utility.Vector3dVector(surface.vertices)
    triangles = o3d.utility.Vector3iVector(surface.faces.astype(np.int32))
    mesh = o3d.geometry.TriangleMesh(vertices, triangles)
    mesh.compute_vertex_normals()
    if isinstance(like, o3d.geometry.TriangleMesh):
        return mesh
    return o3d.t.geometry.TriangleMesh.from_legacy(
        mesh, like.vertex.positions.dtype, like.triangle.indices.dtype
    )
