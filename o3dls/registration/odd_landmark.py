"""The one landmark that cannot be where it was marked, if the others agree and say so.

A landmark that was marked in another vein, or took another's name, pulls the whole pose along. The law is
the test of a mean shift of one observation (Cook and Weisberg 1982, 2.2): without it, the sum of squares must
fall by more than the noise of the others explains. Three others leave three degrees of freedom, from which
no noise can be estimated, so that what is known of landmarks beforehand counts as much as some observations.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..geometry.similarity import fit_similarity, rms_radius
from .landmarks import MUCH_BETTER, determined, errors, readings

FEWEST = 4  # of three landmarks any one may be the wrong one
# noise of a coordinate, in rms radii of the landmarks: 3 mm for the ostia of an atrium, of which a picked
# place has 2 and a changed shape the rest
NOISE = 0.11
PRIOR_OBSERVATIONS = 6.0  # coordinates that this counts for: as many as two landmarks have
CHANCE = 3e-3  # that a landmark is accused where none is wrong
CERTAIN = 0.95  # probability of the accused one among all: out of the plane of four any of them may be wrong


def odd_landmark(prior: Array, measured: Array) -> int | None:
    """Return the row of the landmark, of pairs (n, d), that contradicts all others; None where none does, or
    nothing tells which.
    """
    count, d = prior.shape
    if count < FEWEST:
        return None
    rows = np.arange(count)
    if not all(determined(side[rows != i]) for side in (prior, measured) for i in rows):
        return None
    rest = np.array([_sum_squares(prior[rows != i], measured[rows != i]) for i in rows])
    odd = int(rest.argmin())
    if not _exceeds_noise(_sum_squares(prior, measured), float(rest[odd]), prior):
        return None
    likelihood = (_spread(rest, prior) / _spread(rest[odd], prior)) ** (-_freedom(count - 1, d) / 2.0)
    sure = likelihood[odd] > CERTAIN * likelihood.sum()
    return odd if sure and not _explained_by_names(prior, measured) else None


def _exceeds_noise(whole: float, rest: float, prior: Array) -> bool:
    """Say whether the fall of the sum of squares is beyond what chance gives the worst of n landmarks."""
    from scipy.special import fdtrc  # of scipy.stats, whose import takes a quarter of a second, it is f.sf

    count, d = prior.shape
    freedom = _freedom(count - 1, d)
    ratio = (whole - rest) / d / (float(_spread(rest, prior)) / freedom)
    return bool(fdtrc(d, freedom, ratio) * count < CHANCE)


def _spread(rest: Array | float, prior: Array) -> Array:
    """Return sums of squares with those that are known beforehand."""
    return np.asarray(rest + PRIOR_OBSERVATIONS * (NOISE * rms_radius(prior)) ** 2)


def _freedom(count: int, d: int) -> float:
    """Return the degrees of freedom of a rigid fit of so many landmarks, with those known beforehand."""
    return PRIOR_OBSERVATIONS + d * count - d * (d + 1) / 2.0


def _sum_squares(prior: Array, measured: Array) -> float:
    return float((errors(prior, measured, fit_similarity(prior, measured, scale=False)) ** 2).sum())


def _explained_by_names(prior: Array, measured: Array) -> bool:
    """Say whether an exchange of names, for which a case is refused, explains the errors too."""
    named, *found = readings(prior, measured, np.ones(len(prior)), scale=False)
    return min(one.rms for one in found if not one.mirrored) < MUCH_BETTER * named.rms
