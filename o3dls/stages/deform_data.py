"""From a case to the arrays that a motion is fitted to: points, noise, odds of contact, landmarks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..case import Case, Points
from ..columns import moments_of
from ..evaluation.trusted_landmarks import trusted_pairs
from ..geometry.similarity import rms_radius
from .deform_parameters import DeformParameters

if TYPE_CHECKING:
    from ..motion.field.observations import Data

NEVER = 1e-250  # odds of being an outlier that no residual outweighs, and whose logarithm is still a number


def observed(case: Case, stage: DeformParameters, before: Data | None = None) -> Data:
    """Return the fitted points as arrays: eam and inside points in noise group 0, ablation points in group 1,
    landmarks apart.

    `before`, the points of an earlier fit, fix what the points' own noise is relative to, and the distance
    within which points share one place.
    """
    from ..motion.field.observations import Data
    from ..noise.duplicates import distinct_places, duplicate_distance

    every = case.points.of(*stage.fits)
    size = rms_radius(case.prior.vertices)
    near = duplicate_distance(every.xyz, every.type, size) if before is None else before.duplicate_distance
    typical = every.typical_sigma if before is None or before.typical_sigma is None else before.typical_sigma
    rows, same = distinct_places(every.xyz, every.type, near)
    points = every.select(rows)
    _, marks_prior, marks_map = trusted_pairs(case)
    keep = slice(None) if stage.landmarks else slice(0)
    return Data(
        points=points.xyz,
        group=(points.type == "ablation").astype(np.int64),
        relative=every.relative_noise(typical)[rows],
        odds=outlier_odds(points, stage.contact_force) * (1.0 if stage.outliers == "find" else NEVER),
        inside=points.type == "inside",
        marks_prior=marks_prior[keep],
        marks_map=marks_map[keep],
        groups=1 + (stage.ablation == "fit"),
        mapping=same[every.type == "eam"],
        typical_sigma=typical,
        duplicate_distance=near,
        order=points.taken,
        moment=moments_of(points.columns, points.type),
        isolation=_isolation_factors(points, size),
    )


def _isolation_factors(points: Points, size: float) -> Array:
    """Return factors (n,) on the odds of being an outlier by how many others are near; `inside` points have
    none.
    """
    from ..noise.contact import isolation_odds
    from ..noise.settings import ContactSettings

    factors = np.ones(len(points))
    wall = points.type != "inside"
    factors[wall] = isolation_odds(points.xyz[wall], size, ContactSettings())
    return factors


def outlier_odds(points: Points, force: float) -> Array:
    """Return the factor (n,) on the odds of being an outlier, between 1/4 and 4.

    Doubled for each `force` (g) that the contact force is too low, halved for each that it is higher.
    """
    measured = points.numbers("force")
    return np.where(np.isfinite(measured), 2.0 ** np.clip((force - measured) / force, -2.0, 2.0), 1.0)


def differences(data: Data, before: Data) -> str:
    """Return what of the data of an earlier fit is not the same in the first of these data, in words; empty
    where nothing.
    """
    if len(data.points) < len(before.points):
        return f"{len(data.points)} points, fewer than the {len(before.points)} of the estimate"
    changed = data.at(slice(len(before.points))).differs(before)
    if changed.any():
        return (
            f"point {np.argmax(changed)} is not what it was in the estimate (place, type, sigma, force), or "
            "the stage's contact_force or outliers are not; append new points behind the others"
        )
    marks = ((data.marks_prior, before.marks_prior), (data.marks_map, before.marks_map))
    if not all(np.array_equal(now, then) for now, then in marks):
        return "the landmarks are not those of the estimate; fit it again"
    return ""
