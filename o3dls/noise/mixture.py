"""Inliers and outliers of a catheter: on the wall with normal noise, or off it, nearly always on the
inside.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Array
from .robust import robust_sd

DEPTH = 0.5  # how deep outliers lie, evenly, relative to the surface's rms radius
# share of the outliers that lie inside; the rest, and the deeper ones, are spread over twice the radius
INSIDE = 0.95
ROUNDS = 40
ROOT = math.sqrt(2.0 * math.pi)


class Mixture(NamedTuple):
    """Probability (n,) of each point to lie on the wall, the noise of those that do (same unit), and the
    share of those that do not.
    """

    weights: Array
    sigma: float
    outliers: float


def fit_mixture(signed: Array, radius: float, loosening: float = 1.0) -> Mixture:
    """Fit signed distances (n,), negative inside, by expectation maximisation; weights are for a noise
    `loosening` times as large.
    """
    density = _outlier_density(np.asarray(signed, dtype=np.float64), DEPTH * radius, 2.0 * radius)
    sigma, share = _fit(signed, density, max(robust_sd(signed), 1e-9 * radius), 1e-9 * radius)
    return Mixture(_posterior(signed, density, loosening * sigma, share), sigma, share)


def _outlier_density(signed: Array, depth: float, reach: float) -> Array:
    return np.where((signed < 0.0) & (signed > -depth), INSIDE / depth, (1.0 - INSIDE) / reach)


def _posterior(signed: Array, density: Array, sigma: float, share: float) -> Array:
    inlier = (1.0 - share) * np.exp(-0.5 * (signed / sigma) ** 2) / (ROOT * sigma)
    return np.asarray(inlier / (inlier + share * density))


@njit(cache=True)
def _fit(signed, density, sigma, floor):  # type: ignore[no-untyped-def]
    """Noise and outlier share at rest."""
    share = 0.1
    n = len(signed)
    for _ in range(ROUNDS):
        total, square = 0.0, 0.0
        for i in range(n):
            inlier = (1.0 - share) * math.exp(-0.5 * (signed[i] / sigma) ** 2) / (ROOT * sigma)
            weight = inlier / (inlier + share * density[i])
            total += weight
            square += weight * signed[i] * signed[i]
        share = min(max(1.0 - total / n, 0.01), 0.6)
        last = sigma
        sigma = max(math.sqrt(square / max(total, 1e-300)), floor)
        if abs(sigma - last) < 1e-4 * sigma:
            break
    return sigma, share
