"""Stage `icp`: iterative closest points from the measured points to the prior surface, in the variants of the
literature.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from ..adapters.open3d_steps import KERNELS
from ..arrays import Array
from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry.similarity import rms_radius
from ..plugins.stage import Stage

if TYPE_CHECKING:
    from ..registration.icp import Alignment, Belief, Solver
    from ..registration.match import SurfaceMatcher
    from ..registration.metrics import Metric
    from ..registration.reject import Rule

MetricName = Literal["point_to_point", "point_to_plane", "symmetric", "generalized"]
KernelName = Literal["none", "huber", "cauchy", "geman_mcclure", "tukey", "welsch", "mixture"]
RuleName = Literal["threshold", "trimmed", "deviations", "mad", "reciprocal", "normal_angle"]

PRESETS: Mapping[str, Mapping[str, Any]] = {
    # Besl and McKay 1992, as most comparisons run it: rigid, every pair, equal weights
    "standard": {
        "metric": "point_to_point",
        "scale": False,
        "strain_sd": None,
        "kernel": "none",
        "freeze": None,
        "coarse": 1.0,
    },
    # as clinical systems mend it: rigid, far pairs rejected by statistics that tighten from coarse to fine
    "modified": {
        "metric": "point_to_point",
        "scale": False,
        "strain_sd": None,
        "kernel": "none",
        "freeze": None,
        "coarse": 3.0,
        "reject": ("deviations",),
    },
    # the strongest we know, hence the defaults: similarity, tangent planes, outliers told by depth,
    # undetermined directions left alone
    "robust": {},
}
PARAMETER_OF: Mapping[str, str] = {
    "threshold": "threshold",
    "trimmed": "keep",
    "deviations": "deviations",
    "mad": "mad",
    "reciprocal": "slack",
    "normal_angle": "angle",
}
ONLY_OURS = ("scale_sd", "strain_sd", "freeze")
NULLABLE = (*ONLY_OURS, "kernel_width")
NEEDS_PLANES = ("freeze", "strain_sd")  # to metric point_to_point every direction looks determined


def unit(name: str) -> dict[str, Any]:
    return {"unit": name}


class ICP(Stage):
    """Move the prior onto the points by iterative closest points, points to surface; `preset` sets what is
    not given.
    """

    name: ClassVar[str] = "icp"
    preset: Literal["standard", "modified", "robust"] = Field(
        "robust", description="values of the parameters that are not given"
    )
    engine: Literal["o3dls", "open3d"] = Field(
        "o3dls", description="whose estimator makes a step; matching and rejection are always ours"
    )
    metric: MetricName = Field("point_to_plane", description="what a step minimises")
    scale: bool = Field(True, description="let the scale change: a similarity instead of a rigid motion")
    scale_sd: float | None = Field(
        0.2,
        ge=1e-6,
        description="log scale is pulled to zero with this sd; none: not pulled",
        json_schema_extra=unit("1"),
    )
    scale_min: float = Field(0.5, gt=0.0, le=1.0, description="smallest scale", json_schema_extra=unit("1"))
    scale_max: float = Field(2.0, ge=1.0, description="largest scale", json_schema_extra=unit("1"))
    strain_sd: float | None = Field(
        0.015,
        ge=1e-6,
        description="sd of a strain fitted on the way, so that it does not bend the pose; none: no strain",
        json_schema_extra=unit("1"),
    )
    kernel: KernelName = Field(
        "mixture",
        description=(
            "weights of the residuals; mixture: probability to lie on the wall, not inside the cavity"
        ),
    )
    kernel_width: float | None = Field(
        None,
        gt=0.0,
        description="width of the kernel; none: 95 % efficient on clean points",
        json_schema_extra=unit("robust sd"),
    )
    reject: tuple[RuleName, ...] = Field((), description="rules that drop pairs, one or several")
    threshold: float = Field(
        10.0, gt=0.0, description="rule threshold: longest distance", json_schema_extra=unit("mm")
    )
    keep: float = Field(
        0.9,
        gt=0.0,
        le=1.0,
        description="rule trimmed: fraction of the pairs, the closest",
        json_schema_extra=unit("1"),
    )
    deviations: float = Field(
        2.5, gt=0.0, description="rule deviations: distances up to mean + this", json_schema_extra=unit("sd")
    )
    mad: float = Field(
        3.0,
        gt=0.0,
        description="rule mad: distances up to median + this",
        json_schema_extra=unit("robust sd"),
    )
    slack: float = Field(
        1.5,
        ge=1.0,
        description="rule reciprocal: longest distance over that of the foot's nearest point",
        json_schema_extra=unit("1"),
    )
    angle: float = Field(
        0.8,
        gt=0.0,
        le=1.5708,
        description="rule normal_angle: largest angle of the normals",
        json_schema_extra=unit("rad"),
    )
    neighbours: int = Field(12, ge=3, description="points that give a point its normal, where one is needed")
    thickness: float = Field(
        0.05,
        gt=0.0,
        le=1.0,
        description="metric generalized: variance across a patch over along it",
        json_schema_extra=unit("1"),
    )
    freeze: float | None = Field(
        0.05,
        ge=1e-6,
        description="motions less certain than this (rms over the surface) are not made; none: all are",
        json_schema_extra=unit("rms radii"),
    )
    coarse: float = Field(
        1.5,
        ge=1.0,
        le=100.0,
        description="factor on all thresholds and widths at the first iteration",
        json_schema_extra=unit("1"),
    )
    anneal: int = Field(5, ge=0, description="iterations over which it falls to 1")
    tolerance: float = Field(
        5e-3,
        ge=0.0,
        description="converged when no foot moves farther in a step",
        json_schema_extra=unit("mm"),
    )
    iterations: int = Field(100, ge=1, description="most iterations")
    verify: bool = Field(
        False,
        description=(
            "search all rotations, and the mirror image, and refuse a result that another pose clearly beats"
        ),
    )

    @model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, given: Any) -> Any:
        if isinstance(given, dict):  # a pipeline file has no other word for None
            given = {
                name: None if value == "none" and name in NULLABLE else value for name, value in given.items()
            }
        preset = given.get("preset", "robust") if isinstance(given, dict) else None
        if not isinstance(preset, str) or preset not in PRESETS:
            return given
        filled = {**PRESETS[preset], **given}
        if filled.get("metric") == "point_to_point":
            filled |= {name: given.get(name) for name in NEEDS_PLANES}
        if filled.get("engine") == "open3d":
            filled |= {name: given.get(name) for name in ONLY_OURS}
        return filled

    @field_validator("reject", mode="before")
    @classmethod
    def _one_is_a_list(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @model_validator(mode="after")
    def _nothing_in_vain(self) -> ICP:
        for rule, parameter in PARAMETER_OF.items():
            if (
                rule not in self.reject
                and getattr(self, parameter) != type(self).model_fields[parameter].default
            ):
                raise ValueError(
                    f"{parameter} = {getattr(self, parameter)}: has no effect unless reject names '{rule}'"
                )
        if self.kernel_width is not None and self.kernel in ("none", "mixture"):
            raise ValueError(
                f"kernel_width = {self.kernel_width}: has no effect with kernel '{self.kernel}'; must be "
                "left out"
            )
        for parameter in NEEDS_PLANES:
            if getattr(self, parameter) is not None and self.metric == "point_to_point":
                raise ValueError(
                    f"{parameter} = {getattr(self, parameter)}: has no effect with metric "
                    "'point_to_point'; must be left out"
                )
        return self

    @model_validator(mode="after")
    def _open3d_can(self) -> ICP:
        if self.engine == "o3dls":
            return self
        plain = self.metric == "point_to_point"
        kernels = ("none",) if plain else KERNELS
        if self.kernel not in kernels:
            raise ValueError(
                f"kernel = '{self.kernel}': with engine 'open3d' and metric '{self.metric}' must be one "
                f"of {', '.join(kernels)}"
            )
        if self.scale and not plain:
            raise ValueError(
                f"scale = true: Open3D's {self.metric} is rigid; must be false, or metric 'point_to_point'"
            )
        for parameter in ONLY_OURS:
            if getattr(self, parameter) is not None:
                raise ValueError(
                    f"{parameter} = {getattr(self, parameter)}: has no effect with engine 'open3d'; must "
                    "be left out"
                )
        return self

    def obstacle(self, case: Case) -> str | None:
        return (
            "Open3D's estimators are for 3D: use engine 'o3dls'"
            if self.engine == "open3d" and case.dimension == 2
            else None
        )

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..registration.match import SurfaceMatcher

        obstacle = self.obstacle(case)
        if obstacle is not None:
            raise InputError(f"case {case.name}: {obstacle}")
        points = fitted_points(case)
        surface = SurfaceMatcher(case.prior)
        found = self.aligned(points, surface, start.T_map_prior)
        if self.verify:
            from .pose_checks import beaten

            if said := beaten(case.units, points, surface, found, scale=self.scale):
                raise InputError(f"case {case.name}: {said}")
        return as_estimate(case, found, scale=self.scale)

    def aligned(self, points: Array, surface: SurfaceMatcher, T_map_prior: Array) -> Alignment:
        """The pose of the prior's surface that fits points (n, d), from a start pose (d+1, d+1)."""
        from ..registration.icp import Criteria, align
        from ..registration.step import Freedom

        normals = self._point_normals(points)
        return align(
            points,
            surface,
            T_map_prior,
            metric=self._metric(normals),
            rules=tuple(self._rule(name, normals) for name in self.reject),
            belief=self._belief(surface.radius),
            solve=self._solver(normals),
            freedom=Freedom(
                self.scale, self.scale_sd, (self.scale_min, self.scale_max), self.strain_sd, self.freeze
            ),
            criteria=Criteria(self.tolerance, self.iterations, self.coarse, self.anneal),
        )

    def _point_normals(self, points: Array) -> Array:
        """Normals of the points (n, d) where a part needs them, else none (0, d)."""
        from ..registration.normals import point_normals

        needed = self.metric in ("symmetric", "generalized") or "normal_angle" in self.reject
        return point_normals(points, self.neighbours) if needed else points[:0]

    def _metric(self, normals: Array) -> Metric:
        from ..registration import metrics

        if self.metric == "symmetric":
            return metrics.symmetric(normals)
        if self.metric == "generalized":
            return metrics.generalized(normals, self.thickness)
        return metrics.point_to_point if self.metric == "point_to_point" else metrics.point_to_plane

    def _belief(self, radius: float) -> Belief:
        from ..registration import icp

        if self.engine == "open3d":  # which weighs by itself
            return icp.equal
        if self.kernel == "mixture":
            return icp.wall_or_cavity(radius)
        return icp.equal if self.kernel == "none" else icp.m_estimator(self.kernel, self.kernel_width)

    def _solver(self, normals: Array) -> Solver:
        from ..adapters.open3d_steps import open3d_solver
        from ..registration.step import best_motion

        if self.engine == "o3dls":
            return best_motion
        return open3d_solver(self.metric, self.kernel, self.kernel_width, normals, self.thickness)

    def _rule(self, name: RuleName, normals: Array) -> Rule:
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
    """The eam points (n, d), refused where they are too few or all in one place."""
    points = case.points.of("eam").xyz
    places = len(np.unique(points, axis=0))
    fewest = 7 if case.dimension == 3 else 4
    if places < fewest:
        raise InputError(
            f"case {case.name}: {len(points)} eam points in {places} different places: a pose needs "
            f"{fewest} or more"
        )
    return points


def as_estimate(case: Case, found: Alignment, *, scale: bool) -> Estimate:
    """What ICP found, in the words of an estimate, with what the points leave open."""
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
        else f"not converged {rest}, last step {last['step']:.2g} {case.units}",
        converged=found.converged,
        iterations=len(found.trace),
        sigma=mixture.sigma,
        weights=found.weights,
        trace=found.trace,
        warnings=tuple(d.sentence(case.units) for d in directions if d.weak),
        facts={
            "outlier_fraction": mixture.outlier_fraction,
            "observability": [d.record() for d in directions],
        },
    )
