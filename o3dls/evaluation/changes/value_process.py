"""How values vary over a wall: a Gaussian process of a smooth and a patchy part, with noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from ...arrays import Array
from ...errors import InputError

SMOOTH_LENGTH = 25.0  # mm
TURN = 5.0  # mm that a difference of normals counts for: walls back to back are places apart
LEARNT_FROM = 400  # points of a map
STEPS = 120
UNKNOWN = 100.0  # variance of a mean that is not known, over that of the values
# the parts' sds over that of the values, the patchy part's length in mm: where the search begins, and by what
# factor (natural logarithm) they may well be others
BEGIN = np.array([0.7, 0.7, 6.0, 0.4])
MAY_VARY = np.array([1.0, 1.0, 0.7, 1.0])


@dataclass(frozen=True)
class ValueProcess:
    """A value process has the sds of its smooth and its patchy part, the latter's length in mm, and the sd of
    the noise of one point.
    """

    smooth: float
    patchy: float
    length: float
    noise: float

    def covariance(self, a: Array, b: Array) -> Array:
        """Return the covariance (n, m) of values at places (n, 6) and (m, 6), without noise."""
        return self.at_distance(cdist(a, b))

    def at_distance(self, distance: Array) -> Array:
        smooth = decay(distance, SMOOTH_LENGTH)
        return np.asarray(self.smooth**2 * smooth + self.patchy**2 * np.exp(-distance / self.length))

    @property
    def sd(self) -> float:
        """Standard deviation of the values without noise."""
        return float(np.hypot(self.smooth, self.patchy))


def places(vertices: Array, normals: Array) -> Array:
    """Return places (n, 6) whose distances tell a wall from the one at its back."""
    return np.hstack([vertices, TURN * normals])


def decay(distance: Array, length: float) -> Array:
    """Return the Matern 3/2 correlation at distances."""
    scaled = np.sqrt(3.0) / length * distance
    return np.asarray((1.0 + scaled) * np.exp(-scaled))


def learn_process(maps: Sequence[tuple[Array, Array, Array]], seed: int) -> ValueProcess:
    """Return the process that makes maps likely, each with places (k, 6), values (k,) and how many points
    each is the mean of (k,). Each map has a mean of its own, and nothing else in common. Raises InputError
    where the values of each map are all the same.
    """
    rng = np.random.default_rng(seed)
    scale = float(np.sqrt(np.mean([values.var() for _, values, _ in maps])))
    if not scale > 0.0:
        raise InputError("the values of each map are all the same: must be measured, so that they vary")
    some = [rng.permutation(len(values))[:LEARNT_FROM] for _, values, _ in maps]
    seen = [
        (cdist(at[rows], at[rows]), (values[rows] - values[rows].mean()) / scale, count[rows])
        for (at, values, count), rows in zip(maps, some, strict=True)
    ]

    def surprise(log: Array) -> float:
        process = ValueProcess(*np.exp(log))
        prior = 0.5 * float((((log - np.log(BEGIN)) / MAY_VARY) ** 2).sum())
        return prior + sum(_minus_log_likelihood(process, *one) for one in seen)

    options: Any = {"maxiter": STEPS, "xatol": 0.03, "fatol": 0.1}
    found = minimize(surprise, np.log(BEGIN), method="Nelder-Mead", options=options)
    smooth, patchy, length, noise = map(float, np.exp(found.x))
    return ValueProcess(scale * smooth, scale * patchy, length, scale * noise)


def _minus_log_likelihood(process: ValueProcess, distance: Array, values: Array, count: Array) -> float:
    joint = process.at_distance(distance) + UNKNOWN
    joint[np.diag_indices_from(joint)] += process.noise**2 / count
    try:
        factor = np.linalg.cholesky(joint)
    except np.linalg.LinAlgError:  # without noise two points at one place say the same
        return np.inf
    white = solve_triangular(factor, values, lower=True)
    return float(0.5 * white @ white + np.log(np.diag(factor)).sum())
