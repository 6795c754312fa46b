"""How values of a map go with a field of the wall, such as voltage with late enhancement: a line through
points whose places are known with an error.

A point has the value V = a + b F(r) + e, where F is the field at the place r of the wall that it was taken
on. The registration brings it to another place, where F differs: errors in the variable, which make the line
flatter. But given prior and points, r is distributed as the samples of the surface have it. With m = E[F(r)]
over the samples,

    V = a + b m + (e + b (F(r) - m)),

and what is in brackets has the mean 0 whatever m is, as in Berkson's model (J Am Stat Assoc 1950): the line
on m is the true one, if the samples are right. This is regression calibration (Carroll, Ruppert, Stefanski
and Crainiceanu, Measurement Error in Nonlinear Models, 2006, chapter 4). Errors of neighbours go together,
and so do values that F does not explain: the line is fitted by generalised least squares with the covariance

    S = s^2 I + t^2 M(l) + b^2 C,

C = cov F(r) over the samples, M a Matern correlation of a length l. s, t and l are those of the largest
restricted likelihood (Patterson and Thompson 1971); b in S is that of ordinary least squares. The covariance
of (a, b) is (X' S^-1 X)^-1, X = (1, m).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.special import ndtri

from ...arrays import Array
from ...geometry.spread import spread
from ...motion.field.kernels import matern
from .readings import Readings

FEWEST, MOST = 20, 600  # points; of more those are used that lie farthest from each other
LENGTHS = (2.0, 25.0)  # mm, of what the field does not explain
BEGIN = 6.0  # mm
STEP, GAIN, TRIALS = 0.05, 0.02, 120  # of logarithms, and of the likelihood's, at the end; at most


@dataclass(frozen=True, eq=False)
class Line:
    """A line has the level a and slope b, (2,), of values over a field, and their covariance (2, 2); `naive`
    (2,) are those of ordinary least squares at the places nearest to the points; count: of points used.
    """

    found: Array
    covariance: Array
    naive: Array
    count: int

    def slope_interval(self, level: float) -> tuple[float, float]:
        """Return the interval that holds the slope with a probability."""
        half = _quantile(level) * float(np.sqrt(self.covariance[1, 1]))
        return float(self.found[1]) - half, float(self.found[1]) + half

    def crossing_interval(self, value: float, level: float) -> tuple[float, float]:
        """Return the interval that holds where the line has a value, with a probability (Fieller 1954): all f
        with (a + b f - value)^2 <= q^2 var(a + b f). NaN where it has no ends, as the slope may be 0.
        """
        (a, b), cov, q = self.found, self.covariance, _quantile(level) ** 2
        square = b**2 - q * cov[1, 1]
        if square <= 0.0:
            return np.nan, np.nan
        half = b * (a - value) - q * cov[0, 1]
        root = np.sqrt(max(half**2 - square * ((a - value) ** 2 - q * cov[0, 0]), 0.0))
        return float((-half - root) / square), float((-half + root) / square)


def crossing(line: Array, value: float) -> float:
    """Return where a line (2,) of level and slope has a value; NaN where it is level."""
    return float((value - line[0]) / line[1]) if line[1] else np.nan


def fit_line(values: Array, read: Readings) -> Line | None:
    """Fit the line of values (n,) over a field that was read at their points; None where fewer than 20 have
    a value and lie where the field is known, or it is the same everywhere.
    """
    usable = np.isfinite(values) & read.near & np.isfinite(read.naive) & np.isfinite(read.drawn).all(axis=0)
    if usable.sum() < FEWEST:
        return None
    values, read = values[usable], read.of(usable)
    if len(values) > MOST:
        some = np.zeros(len(values), dtype=bool)
        some[spread(read.at, MOST)] = True
        values, read = values[some], read.of(some)
    mean = read.drawn.mean(axis=0)
    if min(np.ptp(mean), np.ptp(read.naive), np.ptp(values)) <= 0.0:
        return None
    off = read.drawn - mean
    covariance = off.T @ off / len(off)
    found, of_found = _fit_generalised(values, _design(mean), read.at, covariance)
    naive = np.asarray(np.linalg.lstsq(_design(read.naive), values, rcond=None)[0], dtype=np.float64)
    return Line(found, of_found, naive, len(values))


def _fit_generalised(values: Array, design: Array, at: Array, misread: Array) -> tuple[Array, Array]:
    """Return level and slope (2,) and their covariance (2, 2)."""
    first = np.linalg.lstsq(design, values, rcond=None)[0]
    scatter = float(np.var(values - design @ first))
    shared = first[1] ** 2 * misread
    bounds = np.log(LENGTHS)

    def solve(logs: Array) -> tuple[Any, Any, Array, Array]:
        own, smooth, length = np.exp([*logs[:2], np.clip(logs[2], *bounds)])
        whole = smooth * matern(at, at, length) + shared
        whole[np.diag_indices_from(whole)] += own
        factor = cho_factor(whole, lower=True)
        precision = design.T @ cho_solve(factor, design)
        found = np.linalg.solve(precision, cho_solve(factor, design).T @ values)
        return factor, precision, np.asarray(found), values - design @ found

    def energy(logs: Array) -> float:  # of the restricted likelihood, without constants
        factor, precision, _, rest = solve(logs)
        fit = 0.5 * float(rest @ cho_solve(factor, rest))
        return fit + float(np.log(np.diag(factor[0])).sum()) + 0.5 * float(np.linalg.slogdet(precision)[1])

    start = np.log([0.5 * scatter, 0.5 * scatter, BEGIN])
    limits = {"xatol": STEP, "fatol": GAIN, "maxfev": TRIALS}
    best: Any = minimize(energy, start, method="Nelder-Mead", options=limits)  # type: ignore[call-overload]
    _, precision, found, _ = solve(best.x)
    return found, np.asarray(np.linalg.inv(precision))


def _design(field: Array) -> Array:
    return np.column_stack([np.ones(len(field)), field])


def _quantile(level: float) -> float:
    return float(ndtri(0.5 + 0.5 * level))
