"""Stage `landmarks`: the pose that brings named landmarks of the prior onto the measured ones."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from ..case import Case
from ..errors import InputError, did_you_mean
from ..estimate import Estimate
from ..geometry import Array, fit_similarity
from ..registration.landmarks import Reading, better_reading, determined, errors, leave_one_out
from ..stage import Stage


class Landmarks(Stage):
    """Align the prior by its named landmarks (least squares, Umeyama 1991), rigidly or with scale."""

    name: ClassVar[str] = "landmarks"
    scale: bool = Field(False, description="let the landmarks set the scale too; four ostia with 2 mm error know it to some 5 %")
    weights: dict[str, float] = Field(
        default_factory=dict, description="weight of a landmark by name; default 1", json_schema_extra={"unit": "1"}
    )

    def obstacle(self, case: Case) -> str | None:
        names, _, _ = case.landmark_pairs()
        fewest = case.dimension
        return None if len(names) >= fewest else f"{len(names)} landmark pairs: at least {fewest} are needed in {case.dimension}D"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        names, prior, measured = self._pairs(case)
        weights = self._weights(names)
        reading = better_reading(prior, measured, weights, scale=self.scale)
        if reading is not None:
            raise InputError(
                _mixed_up(case, names, reading, errors(prior, measured, fit_similarity(prior, measured, weights, scale=self.scale)))
            )
        matrix = fit_similarity(prior, measured, weights, scale=self.scale)
        misses = errors(prior, measured, matrix)
        rms = float(np.sqrt((misses**2).mean()))
        alone = leave_one_out(prior, measured, weights, scale=self.scale)
        return Estimate(
            surface=case.prior.transformed(matrix),
            T_map_prior=matrix,
            status=f"{'similarity' if self.scale else 'rigid motion'} from {len(names)} landmarks, rms {rms:.2f} {case.units}"
            + _worst(names, alone, case.units),
            iterations=1,
            sigma=rms,
            trace=({"pairs": len(names), "rms": rms},),
            facts={"landmarks": _table(names, misses, alone)},
        )

    def _pairs(self, case: Case) -> tuple[list[str], Array, Array]:
        """Landmark pairs of the case, refused where they fix no pose."""
        obstacle = self.obstacle(case)
        if obstacle is not None:
            raise InputError(f"case {case.name}: {obstacle}; name them in points.csv and prior_landmarks.csv")
        names, prior, measured = case.landmark_pairs()
        for points, file in ((prior, "prior_landmarks.csv"), (measured, "points.csv")):
            if not determined(points):
                raise InputError(
                    f"case {case.name}: the landmarks {', '.join(names)} of {file} lie on one line and leave a rotation free; add one beside the line"
                )
        return names, prior, measured

    def _weights(self, names: list[str]) -> Array:
        for name, weight in self.weights.items():
            if name not in names:
                raise InputError(f"landmarks.weights: no landmark pair '{name}'{did_you_mean(name, names)}")
            if not weight > 0.0:
                raise InputError(f"landmarks.weights: {name} = {weight}: must be above 0")
        return np.array([self.weights.get(name, 1.0) for name in names])


def _mixed_up(case: Case, names: list[str], reading: Reading, misses: Array) -> str:
    """What is wrong with the names, or with the side, in one sentence."""
    rms = float(np.sqrt((misses**2).mean()))
    gain = f"rms error {rms:.3g} {case.units} as named, {reading.rms:.3g} {case.units} otherwise"
    if reading.mirrored:
        return (
            f"case {case.name}: the prior is a mirror image of the measured chamber by its landmarks ({gain}): flip one axis of the prior"
        )
    moved = [names[i] for i, j in enumerate(reading.order) if i != j]
    return f"case {case.name}: the landmarks {' and '.join(moved)} look exchanged ({gain}): correct the names in points.csv or prior_landmarks.csv"


def _worst(names: list[str], alone: Array, units: str) -> str:
    if np.isnan(alone).all():
        return ""
    worst = int(np.nanargmax(alone))
    return f"; left out, {names[worst]} is missed by {alone[worst]:.2f} {units}"


def _table(names: list[str], misses: Array, alone: Array) -> dict[str, Any]:
    return {
        name: {"error": float(miss), "leave_one_out": None if np.isnan(out) else float(out)}
        for name, miss, out in zip(names, misses, alone, strict=True)
    }
