"""Parameters of the stage `icp`: presets, defaults, and which of them go together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from ..adapters.open3d_steps import KERNELS
from ..case import Case
from ..plugins.parameters import parameter_error, unfitting
from ..plugins.stage import Stage

MetricName = Literal["point_to_point", "point_to_plane", "symmetric", "generalized"]
KernelName = Literal["none", "huber", "cauchy", "geman_mcclure", "tukey", "welsch", "mixture"]
RuleName = Literal["threshold", "trimmed", "deviations", "mad", "reciprocal", "normal_angle"]
if TYPE_CHECKING:
    Rules = RuleName | tuple[RuleName, ...]  # as it may be given
else:
    Rules = tuple[RuleName, ...]  # as it is kept

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
    # as clinical systems do it: rigid, far pairs rejected by statistics that tighten from coarse to fine
    "modified": {
        "metric": "point_to_point",
        "scale": False,
        "strain_sd": None,
        "kernel": "none",
        "freeze": None,
        "coarse": 3.0,
        "reject": ("deviations",),
    },
    # the strongest we know, hence the defaults: similarity, tangent planes, outliers found by depth,
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


class ICPParameters(Stage):
    """These parameters are what a user can choose of the variants of ICP."""

    preset: Literal["standard", "modified", "robust"] = Field(
        default="robust", description="values of the parameters that are not given"
    )
    engine: Literal["o3dls", "open3d"] = Field(
        default="o3dls",
        description="who estimates a step from the pairs; matching and rejection are always ours",
    )
    metric: MetricName = Field(default="point_to_plane", description="what a step minimises")
    scale: bool = Field(
        default=True, description="estimate the scale too: a similarity instead of a rigid motion"
    )
    scale_sd: float | None = Field(
        default=0.03,
        ge=1e-6,
        description=(
            "prior standard deviation of the logarithm of the scale, firm since residuals of neighbours "
            "are alike; none: no prior"
        ),
        json_schema_extra=unit("1"),
    )
    scale_min: float = Field(
        default=0.5, gt=0.0, le=1.0, description="smallest scale", json_schema_extra=unit("1")
    )
    scale_max: float = Field(default=2.0, ge=1.0, description="largest scale", json_schema_extra=unit("1"))
    strain_sd: float | None = Field(
        default=0.015,
        ge=1e-6,
        description="sd of a strain fitted with the pose, which it would bias; none: no strain",
        json_schema_extra=unit("1"),
    )
    kernel: KernelName = Field(
        default="mixture",
        description=("weights of the residuals; mixture: probability of touching the wall"),
    )
    kernel_width: float | None = Field(
        default=None,
        gt=0.0,
        description="width of the kernel; none: 95 % efficiency on clean points",
        json_schema_extra=unit("robust sd"),
    )
    reject: Rules = Field(default=(), description="rules that reject pairs, one or several")
    threshold: float = Field(
        default=10.0, gt=0.0, description="rule threshold: longest distance", json_schema_extra=unit("mm")
    )
    keep: float = Field(
        default=0.9,
        gt=0.0,
        le=1.0,
        description="rule trimmed: fraction of the pairs, the closest",
        json_schema_extra=unit("1"),
    )
    deviations: float = Field(
        default=2.5,
        gt=0.0,
        description="rule deviations: distances up to mean + this",
        json_schema_extra=unit("sd"),
    )
    mad: float = Field(
        default=3.0,
        gt=0.0,
        description="rule mad: distances up to median + this",
        json_schema_extra=unit("robust sd"),
    )
    slack: float = Field(
        default=1.5,
        ge=1.0,
        description="rule reciprocal: longest distance over that of the foot's nearest point",
        json_schema_extra=unit("1"),
    )
    angle: float = Field(
        default=0.8,
        gt=0.0,
        le=1.5708,
        description="rule normal_angle: largest angle of the normals",
        json_schema_extra=unit("rad"),
    )
    neighbours: int = Field(
        default=12,
        ge=3,
        le=1000,  # more points than a map has in one place
        description="points that the normal of a point is estimated from, where one is needed",
    )
    thickness: float = Field(
        default=0.05,
        gt=0.0,
        le=1.0,
        description="metric generalized: variance across the surface over that along it",
        json_schema_extra=unit("1"),
    )
    freeze: float | None = Field(
        default=0.05,
        ge=1e-6,
        description="motions less certain than this (rms over the surface) are left out; none: all are made",
        json_schema_extra=unit("rms radii"),
    )
    coarse: float = Field(
        default=1.5,
        ge=1.0,
        le=100.0,
        description="factor on all thresholds and widths at the first iteration",
        json_schema_extra=unit("1"),
    )
    anneal: int = Field(
        default=5, ge=0, le=10_000, description="iterations over which that factor falls to 1"
    )
    tolerance: float = Field(
        default=5e-3,
        ge=0.0,
        description="converged when no foot point moves farther in one step",
        json_schema_extra=unit("mm"),
    )
    # what has not converged by then does not
    iterations: int = Field(default=100, ge=1, le=10_000, description="most iterations")
    verify: bool = Field(
        default=False,
        description=(
            "search all rotations and the mirror image; refuse a result if another pose fits clearly better"
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

    @field_validator("reject", mode="before", json_schema_input_type=RuleName | tuple[RuleName, ...])
    @classmethod
    def _one_is_a_list(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @property
    def rules(self) -> tuple[RuleName, ...]:
        """The rules that reject pairs, in order."""
        return self.reject if isinstance(self.reject, tuple) else (self.reject,)

    @model_validator(mode="after")
    def _nothing_in_vain(self) -> Self:
        for rule, parameter in PARAMETER_OF.items():
            if rule not in self.rules:
                unfitting(self, parameter, f"unless reject names '{rule}'")
        if self.kernel in ("none", "mixture"):
            unfitting(self, "kernel_width", f"with kernel '{self.kernel}'; must be left out")
        if self.metric == "point_to_point":
            self._left_out(NEEDS_PLANES, "metric 'point_to_point'")
        if self.engine == "open3d":
            self._left_out(ONLY_OURS, "engine 'open3d'")
        return self

    def _left_out(self, parameters: tuple[str, ...], with_what: str) -> None:
        for parameter in parameters:
            if getattr(self, parameter) is not None:
                raise parameter_error(self, parameter, f"has no effect with {with_what}; must be left out")

    @model_validator(mode="after")
    def _open3d_can(self) -> Self:
        if self.engine == "o3dls":
            return self
        plain = self.metric == "point_to_point"
        kernels = ("none",) if plain else KERNELS
        if self.kernel not in kernels:
            wanted = f"with engine 'open3d' and metric '{self.metric}' must be one of {', '.join(kernels)}"
            raise parameter_error(self, "kernel", wanted)
        if self.scale and not plain:
            rigid = f"Open3D's {self.metric} is rigid; must be false, or metric 'point_to_point'"
            raise parameter_error(self, "scale", rigid)
        return self

    def obstacle(self, case: Case) -> str | None:
        return (
            "Open3D's estimators are for 3D: use engine 'o3dls'"
            if self.engine == "open3d" and case.dimension == 2
            else None
        )
