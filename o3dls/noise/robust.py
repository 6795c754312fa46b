"""How far a residual is believed: robust spread, and the weights of the usual M-estimators."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import TINY, Array

MAD_TO_SD = 1.4826  # a normal distribution's standard deviation over its median absolute deviation


def robust_sd(residuals: Array) -> float:
    """Return the robust standard deviation of residuals around zero: 1.4826 times their median size."""
    return float(MAD_TO_SD * np.median(np.abs(residuals)))


def _weigh_huber(u: Array) -> Array:
    return 1.0 / np.maximum(u, 1.0)


def _weigh_cauchy(u: Array) -> Array:
    return 1.0 / (1.0 + u**2)


def _geman_mcclure(u: Array) -> Array:
    return 1.0 / (1.0 + u**2) ** 2


def _weigh_tukey(u: Array) -> Array:
    return np.clip(1.0 - u**2, 0.0, None) ** 2


def _weigh_welsch(u: Array) -> Array:
    return np.asarray(np.exp(-(u**2)))


KERNELS: dict[str, Callable[[Array], Array]] = {
    "huber": _weigh_huber,
    "cauchy": _weigh_cauchy,
    "geman_mcclure": _geman_mcclure,
    "tukey": _weigh_tukey,
    "welsch": _weigh_welsch,
}
EFFICIENT_95 = {"huber": 1.345, "cauchy": 2.385, "geman_mcclure": 3.648, "tukey": 4.685, "welsch": 2.985}
"""Width of each kernel in standard deviations at which it loses 5 % of the precision on clean normal
residuals.
"""


def kernel_weights(kernel: str, residuals: Array, width: float) -> Array:
    """Return the weights (n,) in [0, 1] of residuals (n,) under a kernel of the given width (same unit);
    rho'(r) = weight * r.
    """
    return KERNELS[kernel](np.abs(residuals) / max(width, TINY))
