"""Stage `icp`: iterative closest points from the measured points to the prior surface, in every variant of the literature."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry import Array
from ..registration.robust import spread
from ..stage import Stage

MetricName = Literal["point_to_point", "point_to_plane", "symmetric", "generalized"]
KernelName = Literal["none", "huber", "cauchy", "geman_mcclure", "tukey", "welsch"]
RuleName = Literal["threshold", "trimmed", "deviations", "mad", "reciprocal", "normal_angle"]

PRESETS: Mapping[str, Mapping[str, Any]] = {
    # Besl and McKay 1992, as most comparisons run it: rigid, every pair, equal weights
    "standard": {"metric": "point_to_point", "scale": False, "kernel": "none", "reject": (), "freeze": None, "coarse": 1.0},
    # as clinical systems mend it: rigid, far pairs rejected by statistics that tighten from coarse to fine
    "modified": {"metric": "point_to_point", "scale": False, "kernel": "none", "reject": ("deviations",), "freeze": None, "coarse": 3.0},
    # the strongest we know: similarity, tangent planes, redescending weights, undetermined directions left alone
    "robust": {"metric": "point_to_plane", "scale": True, "kernel": "tukey", "reject": (), "freeze": 5.0, "coarse": 2.0},
}
PARAMETER_OF = {
    "threshold": "threshold",
    "trimmed": "keep",
    "deviations": "deviations",
    "mad": "mad",
    "reciprocal": "slack",
    "normal_angle": "angle",
}


class ICP(Stage):
    """Move the prior onto the points by iterative closest points (points to surface); `preset` sets what is not given."""

    name: ClassVar[str] = "icp"
    preset: Literal["standard", "modified", "robust"] = Field("robust", description="values of the parameters that are not given")
    metric: MetricName = Field("point_to_plane", description="what a step minimises")
    scale: bool = Field(True, description="let the scale change: a similarity instead of a rigid motion")
    scale_sd: float | None = Field(0.2, gt=0.0, description="log scale is pulled to zero with this standard deviation; none: not pulled")
    scale_min: float = Field(0.5, gt=0.0, le=1.0, description="smallest scale")
    scale_max: float = Field(2.0, ge=1.0, description="largest scale")
    kernel: KernelName = Field("tukey", description="weights of the residuals")
    kernel_width: float | None = Field(
        None, gt=0.0, description="width of the kernel; default: 95 % efficient on clean points", json_schema_extra={"unit": "robust sd"}
    )
    reject: tuple[RuleName, ...] = Field((), description="rules that drop pairs, one or several")
    threshold: float = Field(10.0, gt=0.0, description="rule threshold: longest distance", json_schema_extra={"unit": "mm"})
    keep: float = Field(0.9, gt=0.0, le=1.0, description="rule trimmed: fraction of the closest pairs kept")
    deviations: float = Field(
        2.5, gt=0.0, description="rule deviations: distances up to mean + this many sd", json_schema_extra={"unit": "sd"}
    )
    mad: float = Field(
        3.0, gt=0.0, description="rule mad: distances up to median + this many robust sd", json_schema_extra={"unit": "robust sd"}
    )
    slack: float = Field(1.5, ge=1.0, description="rule reciprocal: distance of a pair over that of the foot's nearest point")
    angle: float = Field(
        0.8, gt=0.0, le=1.5708, description="rule normal_angle: largest angle of the normals", json_schema_extra={"unit": "rad"}
    )
    neighbours: int = Field(12, ge=3, description="points in a neighbourhood that gives a point its normal")
    thickness: float = Field(1e-3, gt=0.0, le=1.0, description="metric generalized: variance across a patch over along it")
    freeze: float | None = Field(
        None, gt=0.0, description="motions less certain than this (rms over the surface) are not made", json_schema_extra={"unit": "mm"}
    )
    coarse: float = Field(2.0, ge=1.0, description="factor on all thresholds at the first iteration; falls to 1")
    anneal: int = Field(5, ge=0, description="iterations over which it falls")
    tolerance: float = Field(1e-3, ge=0.0, description="converged when no foot moves farther", json_schema_extra={"unit": "mm"})
    iterations: int = Field(100, ge=1, description="most iterations")

    @model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, given: Any) -> Any:
        preset = given.get("preset", "robust") if isinstance(given, dict) else None
        return {**PRESETS[preset], **given} if isinstance(preset, str) and preset in PRESETS else given

    @field_validator("reject", mode="before")
    @classmethod
    def _one_is_a_list(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @model_validator(mode="after")
    def _nothing_in_vain(self) -> ICP:
        for rule, parameter in PARAMETER_OF.items():
            if rule not in self.reject and getattr(self, parameter) != type(self).model_fields[parameter].default:
                raise ValueError(f"{parameter} = {getattr(self, parameter)}: has no effect unless reject names '{rule}'")
        if self.freeze is not None and self.metric == "point_to_point":
            raise ValueError("freeze: has no meaning for metric 'point_to_point', which ties every direction to the start's pairs")
        return self

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..registration.icp import Criteria, Kernel, align
        from ..registration.match import SurfaceMatcher
        from ..registration.step import Freedom

        points = self._points(case)
        normals = self._point_normals(points)
        found = align(
            points,
            SurfaceMatcher(case.prior),
            start.T_map_prior,
            metric=self._metric(normals),
            rules=tuple(self._rule(name, normals) for name in self.reject),
            kernel=None if self.kernel == "none" else Kernel(self.kernel, self.kernel_width),
            freedom=Freedom(self.scale, self.scale_sd, (self.scale_min, self.scale_max), self.freeze),
            criteria=Criteria(self.tolerance, self.iterations, self.coarse, self.anneal),
        )
        last = found.trace[-1]
        kept = int((found.weights > 0.0).sum())
        rest = f"after {len(found.trace)} iterations, {kept} of {len(points)} pairs kept, rms {last['rms']:.2f} {case.units}"
        return Estimate(
            surface=case.prior.transformed(found.T_map_prior),
            T_map_prior=found.T_map_prior,
            status=f"converged {rest}" if found.converged else f"not converged {rest}: still moving {last['step']:.2g} {case.units} a step",
            converged=found.converged,
            iterations=len(found.trace),
            sigma=spread(found.pairs.distances),
            weights=found.weights,
            trace=found.trace,
        )

    def _points(self, case: Case) -> Array:
        """The points to fit, refused where they cannot fix a pose."""
        points = case.points.of("eam").xyz
        fewest = 7 if case.dimension == 3 else 4
        if len(np.unique(points, axis=0)) < fewest:
            raise InputError(
                f"case {case.name}: {len(points)} eam points in {len(np.unique(points, axis=0))} different places: icp needs {fewest} or more"
            )
        return points

    def _point_normals(self, points: Array) -> Array | None:
        from ..registration.normals import point_normals

        needed = self.metric in ("symmetric", "generalized") or "normal_angle" in self.reject
        return point_normals(points, self.neighbours) if needed else None

    def _metric(self, normals: Array | None) -> Any:
        from ..registration import metrics

        if self.metric == "symmetric":
            return metrics.symmetric(normals)
        if self.metric == "generalized":
            return metrics.generalized(normals, self.thickness)
        return metrics.point_to_point() if self.metric == "point_to_point" else metrics.point_to_plane()

    def _rule(self, name: str, normals: Array | None) -> Any:
        from ..registration import reject

        rules = {"threshold": reject.within, "trimmed": reject.trimmed, "deviations": reject.deviations, "mad": reject.median_deviations}
        if name == "normal_angle":
            return reject.normal_angle(self.angle, normals)
        return reject.reciprocal(self.slack) if name == "reciprocal" else rules[name](getattr(self, PARAMETER_OF[name]))
