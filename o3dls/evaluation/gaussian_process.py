"""Interpolation by a Gaussian process, which gives a deviation too."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface
from .projection import Projection

BLOCK = 4096  # vertices taken together, which bounds the memory
MOST_PROCESS_POINTS = 5000
LENGTHS = (4.0, 8.0, 16.0, 32.0, 64.0)
NOISES = (0.01, 0.03, 0.1, 0.3, 1.0)  # of the signal's deviation


def process(wall: Projection, values: Array, surface: Surface, width: float) -> tuple[Array, Array | None]:
    """Gaussian process of Matern 3/2 covariance.

    Length and noise are the likeliest of a grid, which makes `width` superfluous.
    """
    from scipy.linalg import solve_triangular
    from scipy.spatial.distance import cdist

    if len(values) > MOST_PROCESS_POINTS:
        raise InputError(
            f"{len(values)} points are too many for a Gaussian process: at most {MOST_PROCESS_POINTS}; "
            "use method 'gaussian'"
        )
    mean = values.mean()
    scale = max(float(values.std()), 1e-12)
    y = (values - mean) / scale
    between = cdist(wall.foot, wall.foot)
    some = np.linspace(0, len(y) - 1, min(len(y), 500)).astype(int)  # enough to choose by
    length, noise = min(
        ((a, b) for a in LENGTHS for b in NOISES),
        key=lambda c: _minus_log_likelihood(between[np.ix_(some, some)], y[some], *c),
    )
    lower = np.linalg.cholesky(_matern(between, length) + noise**2 * np.eye(len(y)))
    weights = solve_triangular(lower.T, solve_triangular(lower, y, lower=True))
    found, sd = np.empty(len(surface.vertices)), np.empty(len(surface.vertices))
    for start in range(0, len(found), BLOCK):
        block = slice(start, start + BLOCK)
        cross = _matern(cdist(surface.vertices[block], wall.foot), length)
        explained = (solve_triangular(lower, cross.T, lower=True) ** 2).sum(axis=0)
        found[block] = mean + scale * cross @ weights
        sd[block] = scale * np.sqrt(np.maximum(1.0 - explained, 0.0))
    return found, sd


def _matern(distance: Array, length: float) -> Array:
    scaled = np.sqrt(3.0) * distance / length
    return np.asarray((1.0 + scaled) * np.exp(-scaled))


def _minus_log_likelihood(between: Array, y: Array, length: float, noise: float) -> float:
    from scipy.linalg import solve_triangular

    lower = np.linalg.cholesky(_matern(between, length) + noise**2 * np.eye(len(y)))
    return float(np.log(np.diag(lower)).sum() + 0.5 * (solve_triangular(lower, y, lower=True) ** 2).sum())
