"""Crowds: places where most points float.

Where a catheter does not reach the wall, its points fill a volume. Believed one by one, the nearest draw the
wall in until it lies among them, for each of them alone is more likely on a wall than floating. That most of
their neighbours float tells otherwise. Points of a wall that lies elsewhere are a sheet: once the wall is on
it none of them floats, and there is no crowd.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from ..arrays import Array, Mask
from .settings import CrowdSettings


def possible_crowds(points: Array, weights: Array, settings: CrowdSettings) -> list[Mask]:
    """Return crowds (n,) that points (n, d) may have, the narrowest first, by their probabilities of contact
    (n,): the points of whose neighbours at least some share floats. None where so few float together that
    they are outliers as usual, or where they would be most of the map.
    """
    count = min(settings.neighbours, len(points) - 1)
    if count < settings.least:
        return []
    near = np.asarray(KDTree(points).query(points, count + 1)[1])[:, 1:]
    floating = (1.0 - weights)[near].mean(axis=1)
    if (floating > settings.seed).sum() < settings.least:
        return []
    found = [floating > share for share in settings.shares]
    return [crowd for crowd in found if crowd.mean() < settings.majority]


def carried_factors(points: Array, known: Array, factors: Array) -> Array:
    """Return the factors (n,) of points (n, d): those of the nearest of the known points (k, d) and their
    factors (k,).
    """
    return np.asarray(factors[KDTree(known).query(points)[1]])
