"""Points on the wall and outliers, told apart by signed distances alone: noise and outlier fraction by
expectation maximisation, with outliers as `contact` expects them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import TINY, Array
from .contact import Contact
from .robust import robust_sd
from .settings import ContactSettings, MixtureSettings

SQRT_2PI = math.sqrt(2.0 * math.pi)
DEFAULTS = MixtureSettings()


class Mixture(NamedTuple):
    """A mixture gives the probability (n,) of each point to lie on the wall, the noise of those that do (same
    unit), and the fraction of those that do not.
    """

    weights: Array
    sigma: float
    outlier_fraction: float


class _Level(NamedTuple):
    """Points have this noise, and this fraction of them are outliers."""

    sigma: float
    fraction: float


class _Bounds(NamedTuple):
    """These are the bounds of the noise and of the fraction of outliers."""

    least_sigma: float
    least_fraction: float
    most_fraction: float


def fit_mixture(
    signed: Array,
    radius: float,
    contact: ContactSettings | None = None,
    *,
    loosening: float = 1.0,
    settings: MixtureSettings = DEFAULTS,
) -> Mixture:
    """Fit signed distances (n,), negative inside, from a surface of rms radius `radius`.

    loosening: the weights are for a noise so many times as large.
    """
    contact = contact or ContactSettings()
    density = Contact.expected(radius, contact).outlier_density(np.asarray(signed, dtype=np.float64))
    least = settings.least_noise * radius
    bounds = _Bounds(least, contact.least_fraction, contact.most_fraction)
    start = _Level(max(robust_sd(signed), least), contact.outlier_fraction)
    sigma, fraction = _fit_mixture(signed, density, start, bounds, settings.iterations, settings.tolerance)
    return Mixture(_inlier_probability(signed, density, loosening * sigma, fraction), sigma, fraction)


def _inlier_probability(signed: Array, density: Array, sigma: float, fraction: float) -> Array:
    inlier = (1.0 - fraction) * np.exp(-0.5 * (signed / sigma) ** 2) / (SQRT_2PI * sigma)
    return np.asarray(inlier / (inlier + fraction * density))


@njit(cache=True, nogil=True)
def _fit_mixture(signed, density, start, bounds, iterations, tolerance):  # type: ignore[no-untyped-def]
    """Fit noise and outlier fraction until they rest."""
    sigma, fraction = start
    n = len(signed)
    for _ in range(iterations):
        total = 0.0
        square = 0.0
        for i in range(n):
            inlier = (1.0 - fraction) * math.exp(-0.5 * (signed[i] / sigma) ** 2) / (SQRT_2PI * sigma)
            weight = inlier / (inlier + fraction * density[i])
            total += weight
            square += weight * signed[i] * signed[i]
        fraction = min(max(1.0 - total / n, bounds.least_fraction), bounds.most_fraction)
        last = sigma
        sigma = max(math.sqrt(square / max(total, TINY)), bounds.least_sigma)
        if abs(sigma - last) < tolerance * sigma:
            break
    return _Level(sigma, fraction)
