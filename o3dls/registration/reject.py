"""Which pairs are kept: the rejection rules of the ICP literature, each a function of the pairs that returns
a mask (n,).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Array, Mask
from ..noise.robust import MAD_TO_SD
from .match import Pairs

Rule = Callable[[Pairs, float], Mask]
"""A rule takes the pairs and the loosening (>= 1) of a coarse-to-fine schedule."""


def within(threshold: float) -> Rule:
    """Return the pairs not farther apart than a constant distance."""
    return lambda pairs, loosening: pairs.distances <= threshold * loosening


def trimmed(keep: float) -> Rule:
    """Return the given fraction of pairs with the smallest distances (Chetverikov 2005)."""

    def rule(pairs: Pairs, loosening: float) -> Mask:
        count = int(np.ceil(min(1.0, keep * loosening) * len(pairs.points)))
        mask = np.zeros(len(pairs.points), dtype=bool)
        mask[np.argsort(pairs.distances, kind="stable")[:count]] = True
        return mask

    return rule


def deviations(multiple: float) -> Rule:
    """Return the pairs whose distance is at most the mean plus a multiple of the standard deviation of all
    distances (Zhang 1994).
    """

    def rule(pairs: Pairs, loosening: float) -> Mask:
        distances = pairs.distances
        return np.asarray(distances <= distances.mean() + multiple * loosening * distances.std())

    return rule


def median_deviations(multiple: float) -> Rule:
    """Return the pairs whose distance is at most the median plus a multiple of the scaled median absolute
    deviation.
    """

    def rule(pairs: Pairs, loosening: float) -> Mask:
        distances = pairs.distances
        middle = np.median(distances)
        return np.asarray(
            distances <= middle + multiple * loosening * MAD_TO_SD * np.median(np.abs(distances - middle))
        )

    return rule


def reciprocal(slack: float) -> Rule:
    """Return the pairs whose foot has its own point as the nearest measured point, or one at most `slack`
    times as far (Pajdla 1995).
    """

    def rule(pairs: Pairs, loosening: float) -> Mask:
        from scipy.spatial import cKDTree

        nearest, _ = cKDTree(pairs.points).query(pairs.feet)
        return np.asarray(pairs.distances <= nearest * slack * loosening + 1e-12)

    return rule


def normal_angle(limit: float, point_normals: Array) -> Rule:
    """Return the pairs whose surface normal and unoriented point normal (n, d) enclose at most `limit`
    radians.
    """

    def rule(pairs: Pairs, loosening: float) -> Mask:
        cosine = np.abs((pairs.normals * point_normals).sum(axis=1))
        return np.asarray(cosine >= np.cos(min(np.pi / 2.0, limit * loosening)))

    return rule
