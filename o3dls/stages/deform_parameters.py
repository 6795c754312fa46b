"""Parameters of the stage `deform`, and the settings of the motion that they stand for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field, field_validator

from ..case import FITTED_TYPES
from ..plugins.stage import Stage

if TYPE_CHECKING:
    from ..motion.settings import MotionSettings


class DeformParameters(Stage):
    """These parameters are what a user can choose of the motion."""

    vector: tuple[float, ...] = Field(
        default=(1.15, 0.46),
        min_length=1,
        max_length=10,  # each is a field with its own amplitude, and points tell few apart
        description="correlation lengths of the vector field",
        json_schema_extra={"unit": "rms radii"},
    )
    normal: tuple[float, ...] = Field(
        default=(0.46,),
        max_length=10,
        description="correlation lengths of the field along the normal",
        json_schema_extra={"unit": "rms radii"},
    )
    landmarks: bool = Field(
        default=True,
        description=(
            "fit the named landmarks too, with their own noise level, and let the surface around each "
            "landmark move independently"
        ),
    )
    ablation: Literal["hold_out", "fit"] = Field(
        default="hold_out", description="hold ablation points out, or fit them with their own noise level"
    )
    outliers: Literal["find", "none"] = Field(
        default="find",
        description="find points that do not touch the wall, or assume that every point touches it",
    )
    contact_force: float = Field(
        default=5.0,
        gt=0.0,
        description="contact force at which a point is as likely to touch the wall as an average point",
        json_schema_extra={"unit": "g"},
    )
    amplitude_log_sd: float = Field(
        default=1.0,
        gt=0.0,
        description=(
            "standard deviation of the logarithm of a field's amplitude, before the points are seen; bends "
            "and noise have half of it"
        ),
        json_schema_extra={"unit": "1"},
    )
    odds: float = Field(
        default=0.0,
        description=(
            "log odds against a motion beyond the pose, before the points are seen; raise it for priors "
            "that hardly deform"
        ),
        json_schema_extra={"unit": "nats"},
    )
    roughness: Literal["smooth", "keep"] = Field(
        default="smooth",
        description="smooth a prior that the points show to be rougher than the wall, or keep its detail",
    )
    map_shift: Literal["report", "fit", "ignore"] = Field(
        default="report",
        description=(
            "warn where one part of the map is shifted as a whole, as if the patient had moved; or "
            "estimate that shift and take it out of its points; or do not ask"
        ),
    )
    shared_errors: Literal["find", "ignore"] = Field(
        default="find",
        description="tell errors that points share with those taken before and after them from the wall, or "
        "take all errors as independent",
    )
    starts: Literal["auto", "given", "several"] = Field(
        default="auto",
        description=(
            "fit from the given pose, from those of the landmarks too, and keep the most probable result; "
            "auto: from those if landmarks are used, and the first leaves more noise than contact does"
        ),
    )
    iterations: int = Field(
        default=25,
        ge=15,
        le=1000,  # what has not converged by then does not
        description="most iterations; the evidence sets the amplitudes three times in the first 14",
    )

    @field_validator("vector", "normal")
    @classmethod
    def _check_lengths(cls, lengths: tuple[float, ...]) -> tuple[float, ...]:
        if not all(0.0 < length < np.inf for length in lengths):
            raise ValueError("a correlation length must be above 0")
        return lengths

    @property
    def fits(self) -> tuple[str, ...]:
        return (*FITTED_TYPES, "ablation") if self.ablation == "fit" else FITTED_TYPES

    def settings(self) -> MotionSettings:
        """Return the settings of the motion: the parameters in place of their defaults."""
        from ..motion.settings import MotionSettings

        usual = MotionSettings()
        lengths = usual.selection.smoothing_lengths if self.roughness == "smooth" else ()
        return replace(
            usual,
            covariance=replace(
                usual.covariance,
                vector_lengths=self.vector,
                normal_lengths=self.normal,
                field_log_sd=self.amplitude_log_sd,
            ),
            iteration=replace(usual.iteration, iterations=self.iterations),
            selection=replace(usual.selection, motion_log_odds=self.odds, smoothing_lengths=lengths),
        )
