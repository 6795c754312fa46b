"""From a case to the arrays that a motion is fitted to (points, noise, odds of contact, landmarks), and
warnings of mistakes in it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..case import Case, Points
from ..columns import moments_of
from ..evaluation.trusted_landmarks import trusted_pairs
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface
from ..run_warning import RunWarning
from .deform_parameters import DeformParameters
from .pose_checks import swapped_landmarks

if TYPE_CHECKING:
    from ..motion.field.observations import Data
    from ..motion.problem import MotionProblem

NEVER = 1e-250  # odds of being an outlier that no residual outweighs, and whose logarithm is still a number
# area of a prior's smooth wall over its own: patients' have .94 and more, stairs of label volumes .79
SMOOTH = 0.7
UNITS_APART = 100.0  # no map has points a hundred times as good as others; a column in two units has


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


def case_warnings(
    case: Case, kinds: tuple[str, ...], pose: Array, problem: MotionProblem
) -> list[RunWarning]:
    """Warn of mistakes in the prior, its landmarks in the start pose, and the column `sigma` of the points of
    some kinds.
    """
    return [
        *swapped_landmarks(case, pose),
        *_warn_if_crumpled(problem),
        *_small_components(case.prior),
        *_warn_of_sigma(case.points.of(*kinds), case.units),
    ]


def _warn_if_crumpled(problem: MotionProblem) -> list[RunWarning]:
    """Warn if a fold of the prior is near every point: distances to such a wall tell little."""
    from ..geometry.differential import facing

    fraction = facing(problem.rest.at, problem.faces, problem.rest.normals)
    if fraction > SMOOTH:
        return []
    sentence = (
        f"the prior is crumpled ({1.0 / fraction:.2g} times the area of a smooth wall): every point has some "
        "fold nearby, and noise and motion follow the folds; smooth the prior first"
    )
    return [RunWarning("crumpled-prior", sentence)]


def _small_components(prior: Surface) -> list[RunWarning]:
    """Warn if small components lie around the prior: any of them may be nearest to a point."""
    from ..geometry.components import SMALL_COMPONENT, component_areas

    _, areas = component_areas(prior)
    small = int((areas[areas > 0.0] < SMALL_COMPONENT * areas.max()).sum())
    if not small:
        return []
    some = f"{small} small components" if small > 1 else "a small component"
    sentence = f"the prior has {some} that points may be assigned to: remove what does not belong to the wall"
    return [RunWarning("small-components", sentence)]


def _warn_of_sigma(points: Points, unit: str) -> list[RunWarning]:
    """Warn if the column `sigma` may not mean what it says."""
    sigma = points.numbers("sigma")
    given = sigma[np.isfinite(sigma)]
    if len(given) == 0:
        return []
    found = list[RunWarning]()
    missing = len(sigma) - len(given)
    if given.max() > UNITS_APART * given.min():
        sentence = f"sigma ranges from {given.min():.2g} to {given.max():.2g}: are all values in {unit}?"
        found.append(RunWarning("sigma-range", sentence))
    if missing:
        median = f"the median of the others, {points.typical_sigma:.2g} {unit}"
        sentence = f"{missing} of {len(sigma)} points have no sigma: it is taken to be {median}"
        found.append(RunWarning("sigma-missing", sentence))
    return found
