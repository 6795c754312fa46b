"""Stage `icp`: iterative closest points from the measured points to the prior surface, in the variants of the
literature.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..arrays import Array, Ints
from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry.similarity import rms_radius
from ..run_warning import RunWarning
from .icp_parameters import PARAMETER_OF, ICPParameters, RuleName

if TYPE_CHECKING:
    from ..registration.icp import Alignment, Belief, Solver
    from ..registration.match import SurfaceMatcher
    from ..registration.metrics import Metric
    from ..registration.reject import Rule

WEAK = "it matters if you use this pose itself, and landmarks would determine it"


class ICP(ICPParameters):
    """Move the prior onto the points by iterative closest points, points to surface; `preset` sets what is
    not given.
    """

    name: ClassVar[str] = "icp"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..registration.match import SurfaceMatcher

        obstacle = self.obstacle(case)
        if obstacle is not None:
            raise InputError(f"case {case.name}: {obstacle}")
        points, place = fitted_places(case)
        surface = SurfaceMatcher(case.prior)
        found = self.aligned(points, surface, start.T_map_prior)
        if self.verify:
            from .pose_checks import better_pose, own_pose

            some, own = own_pose(points, surface, found, lambda xyz, T: self.aligned(xyz, surface, T))
            if better := better_pose(case.units, some, surface, own, scale=self.scale):
                raise InputError(f"case {case.name}: {better}")
        return as_estimate(case, found, place, scale=self.scale)

    def aligned(self, points: Array, surface: SurfaceMatcher, T_map_prior: Array) -> Alignment:
        """Return the pose of the prior's surface that fits points (n, d), from a start pose (d+1, d+1)."""
        from ..registration.icp import Criteria, Recipe, align
        from ..registration.step import Freedom

        normals = self._point_normals(points)
        bounds = (self.scale_min, self.scale_max)
        recipe = Recipe(
            metric=self._choose_metric(normals),
            freedom=Freedom(self.scale, self.scale_sd, bounds, self.strain_sd, self.freeze),
            rules=tuple(self._choose_rule(name, normals) for name in self.rules),
            belief=self._choose_belief(surface.radius),
            solve=self._choose_solver(normals),
        )
        criteria = Criteria(self.tolerance, self.iterations, self.coarse, self.anneal)
        return align(points, surface, T_map_prior, recipe, criteria)

    def _point_normals(self, points: Array) -> Array:
        """Return the normals of the points (n, d) where a part needs them, else none (0, d)."""
        from ..registration.normals import point_normals

        needed = self.metric in ("symmetric", "generalized") or "normal_angle" in self.rules
        return point_normals(points, self.neighbours) if needed else points[:0]

    def _choose_metric(self, normals: Array) -> Metric:
        from ..registration import metrics

        if self.metric == "symmetric":
            return metrics.symmetric(normals)
        if self.metric == "generalized":
            return metrics.generalized(normals, self.thickness)
        return metrics.point_to_point if self.metric == "point_to_point" else metrics.point_to_plane

    def _choose_belief(self, radius: float) -> Belief:
        from ..registration import icp

        if self.engine == "open3d":  # Open3D weighs the pairs itself
            return icp.equal
        if self.kernel == "mixture":
            return icp.wall_or_cavity(radius)
        return icp.equal if self.kernel == "none" else icp.m_estimator(self.kernel, self.kernel_width)

    def _choose_solver(self, normals: Array) -> Solver:
        from ..adapters.open3d_steps import open3d_solver
        from ..registration.step import best_motion

        if self.engine == "o3dls":
            return best_motion
        return open3d_solver(self.metric, self.kernel, self.kernel_width, normals, self.thickness)

    def _choose_rule(self, name: RuleName, normals: Array) -> Rule:
        from ..registration import reject

        if name == "normal_angle":
            return reject.normal_angle(self.angle, normals)
        rules = {
            "threshold": reject.within,
            "trimmed": reject.trimmed,
            "deviations": reject.deviations,
            "mad": reject.median_deviations,
            "reciprocal": reject.reciprocal,
        }
        return rules[name](getattr(self, PARAMETER_OF[name]))


def fitted_points(case: Case) -> Array:
    """Return the eam points (n, d), refused where they are too few or all in one place."""
    points = case.points.of("eam").xyz
    _check_enough(case, len(points), len(np.unique(points, axis=0)))
    return points


def _check_enough(case: Case, points: int, places: int) -> None:
    fewest = 7 if case.dimension == 3 else 4
    if places < fewest:
        raise InputError(
            f"case {case.name}: {points} eam points in {places} different places: a pose needs "
            f"{fewest} or more"
        )


def fitted_places(case: Case) -> tuple[Array, Ints]:
    """Return the places (k, d) of the eam points, and which of them each point (n,) is of: many beats of one
    contact are one place and count once, else they draw the pose to where they are.
    """
    from ..noise.duplicates import wall_places

    points = fitted_points(case)
    rows, place = wall_places(points, rms_radius(case.prior.vertices))
    _check_enough(case, len(points), len(rows))
    return points[rows], place


def as_estimate(case: Case, found: Alignment, place: Ints, *, scale: bool) -> Estimate:
    """Return the estimate of what ICP found for the places, `place` (n,) being that of each point, with the
    directions that they do not determine.
    """
    from ..noise.mixture import fit_mixture
    from ..registration.observability import spectrum

    mixture = fit_mixture(found.pairs.signed, rms_radius(case.prior.vertices))
    directions = spectrum(found.pairs, found.weights, case.prior.vertices, found.T_map_prior, scale=scale)
    last = found.trace[-1]
    rest = (
        f"after {len(found.trace)} iterations, {last['pairs']} of {len(found.weights)} pairs kept, "
        f"rms {last['rms']:.2f} {case.units}"
    )
    return Estimate(
        surface=case.prior.transformed(found.T_map_prior),
        T_map_prior=found.T_map_prior,
        status=f"converged {rest}"
        if found.converged
        else f"stopped {rest}, last step {last['step']:.2g} {case.units}",
        converged=found.converged,
        iterations=len(found.trace),
        sigma=mixture.sigma,
        weights=found.weights[place],
        trace=found.trace,
        warnings=tuple(
            RunWarning("weak-direction", f"{d.sentence(case.units)}; {WEAK}") for d in directions if d.weak
        ),
        facts={
            "outlier_fraction": mixture.outlier_fraction,
            "observability": [d.record() for d in directions],
        },
    )
