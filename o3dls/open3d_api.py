"""Registration for people with objects of Open3D and its like: a mesh and a point cloud in, names like
`RegistrationResult` and a mesh out.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array
from .case import Case
from .errors import InputError
from .estimate import Estimate
from .evaluation.distances import distances
from .noise.robust import robust_sd
from .registration.landmarks import fix_a_pose
from .runs.run import Run

if TYPE_CHECKING:
    from .adapters.case import Settings
    from .plugins.stage import Stage

log = logging.getLogger("o3dls")
REACH = 3.0  # pairs within this many standard deviations of the noise count as inliers


@dataclass(frozen=True, eq=False)
class Registration:
    """A registration is what `register` found.

    transformation (4, 4): the similarity part, prior to points; surface: the fused surface, an Open3D mesh,
    of the tensor interface where the prior was; fitness: share of the points within the correspondence
    distance of the surface; inlier_rmse: of those points; estimate and run: everything else, as in the rest
    of o3dls.
    """

    transformation: Array
    fitness: float
    inlier_rmse: float
    surface: Any
    estimate: Estimate
    run: Run

    def __repr__(self) -> str:
        return (
            f"Registration(fitness {self.fitness:.3f}, inlier_rmse {self.inlier_rmse:.3g} mm; {self.run!r})"
        )

    def _repr_html_(self) -> str:
        """The same with the scores of the run, as a notebook shows it."""
        found = f"fitness {self.fitness:.3f}, inlier_rmse {self.inlier_rmse:.3g} mm"
        return f"<p>{found}</p>{self.run._repr_html_()}"

    def to(self, kind: str) -> Any:
        """The fused surface as a mesh of trimesh, pyvista, meshio or open3d (tensor), with values per point.

        These are the fields of a run's files (`sd_mm`, `distance_to_nearest_point_mm`, `displacement_mm`,
        `prior_only`, electrical values) and those that the prior came with, such as tags of regions.
        """
        from .adapters import objects
        from .runs.surface_fields import with_fields

        return objects.to(with_fields(self.run.case, self.estimate, self.run.fitted[self.run.final]), kind)


def register(
    prior: Any,
    points: Any,
    *,
    landmarks: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    init: ArrayLike | None = None,
    stages: Sequence[Stage] | None = None,
    max_correspondence_distance: float | None = None,
    **settings: Unpack[Settings],
) -> Registration:
    """Fuse a closed prior with measured points.

    Parameters
    ----------
    prior : mesh or label volume
        of Open3D, trimesh, pyvista, vtk or meshio, arrays (vertices, faces), or of SimpleITK or nibabel; in
        its own frame. Lengths are in mm, unless `units` says otherwise.
    points : point cloud
        of these libraries, an array (n, 3), or columns by name; in the map frame. Values per point by the
        names of a case's columns.
    landmarks : mapping of str to (array (3,), array (3,)), default none
        name -> (position on the prior, position among the points). Three that are not on one line are needed
        for a pose; fewer are not used, which the log says.
    init : array (4, 4), default None
        rough pose, prior to points; landmarks that give one come first.
    stages : sequence of Stage, default those of the default pipeline that the case allows
        steps of the fit.
    max_correspondence_distance : float, mm, default three standard deviations of the noise found
        points within it count as inliers.
    **settings
        `name`, `units`, `frame`, `prior_of`, `phases`, `cap`, and `label`, `part`, `box`, `layer`,
        `fill_slices`, `form` of a label volume, as of `case_of`.

    Returns
    -------
    Registration
        `transformation` (4, 4), prior to points, mm; `surface`, an Open3D mesh in the map frame; `fitness`, a
        share; `inlier_rmse`, mm; `estimate` and `run`.

    Raises
    ------
    InputError
        for what cannot be registered.
    PipelineError
        for stages that do not go together.

    Examples
    --------
    >>> import o3dls
    >>> case = o3dls.read_case("case")
    >>> found = o3dls.register(case.prior, case.points, stages=[o3dls.ICP()])
    >>> found.transformation.shape, found.fitness > 0.9
    ((4, 4), True)
    """
    from .adapters.case import case_of
    from .adapters.meshes import open3d_like
    from .pipeline.file import default_pipeline
    from .pipeline.pipeline import Pipeline

    if max_correspondence_distance is not None and not max_correspondence_distance > 0.0:
        raise InputError(f"max_correspondence_distance = {max_correspondence_distance} mm: must be above 0")
    case = case_of(prior, points, landmarks=landmarks, init=init, **settings)
    if case.dimension != 3:
        raise InputError(
            "prior: is an outline in 2D, and results are meshes in 3D: use case_of and a Pipeline"
        )
    pipeline = (
        Pipeline(stages, folds=0)
        if stages is not None
        else Pipeline(default_pipeline().stages, folds=0).allowed_by(case)
    )
    if unused := _unused_landmarks(case, landmarks or {}):
        log.warning("landmarks: %s", unused)
    run = pipeline.run(case)
    estimate = run.estimates[run.final]
    gap = distances(run.case.points.of("eam").xyz, estimate.surface)
    noise = estimate.sigma or robust_sd(gap)
    near = gap <= (REACH * noise if max_correspondence_distance is None else max_correspondence_distance)
    return Registration(
        transformation=estimate.T_map_prior,
        fitness=float(near.mean()),
        inlier_rmse=float(np.sqrt((gap[near] ** 2).mean())) if near.any() else 0.0,
        surface=open3d_like(estimate.surface, prior),
        estimate=estimate,
        run=run,
    )


def _unused_landmarks(case: Case, landmarks: Mapping[str, Any]) -> str:
    """Return a sentence on landmarks that do not give a pose; empty where they do, or there are none."""
    _, prior, measured = case.landmark_pairs()
    if not landmarks or fix_a_pose(prior, measured):
        return ""
    why = "on one line" if len(landmarks) >= 3 else "three that are not on one line are needed for a pose"
    return f"{', '.join(map(str, landmarks))} are not used for the pose: {why}"
