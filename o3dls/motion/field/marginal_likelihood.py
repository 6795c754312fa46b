"""Evidence of amplitudes and noise levels: what maximises it, and the free energy of points that are believed
in part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from ...arrays import Array, Ints
from ...errors import SolverError
from ..settings import IterationSettings
from .covariance import Covariance, grams
from .gaussian_process import Posterior, solve
from .kernels import add_scaled
from .observations import Rows

REFUSED = 1e12  # nats: an energy so high that the line search turns back
OVERFLOW = 100.0  # logarithms: a longer step overflows
# -log evidence, its slopes along the logarithms of amplitudes, and of each row's noise (n,)
Terms = tuple[float, list[float], Array]


@dataclass(frozen=True)
class Scales:
    """Scales are the logarithms of what the evidence tunes: field amplitudes first, then the deviations of
    offsets that go together, if there are any (`drift`), then one noise level per group of points; with their
    priors and the least values allowed.
    """

    log: Array
    prior_log: Array
    prior_log_sd: Array
    least: Array
    fields: int
    drifts: int = 0

    @property
    def amplitudes(self) -> int:
        """How many stand before the noise levels."""
        return self.fields + self.drifts

    @property
    def sds(self) -> Array:
        return np.asarray(np.exp(self.log[: self.fields]))

    @property
    def drift_sds(self) -> Array:
        return np.asarray(np.exp(self.log[self.fields : self.amplitudes]))

    @property
    def noises(self) -> Array:
        return np.asarray(np.exp(self.log[self.amplitudes :]))

    def errors(self, group: Ints, relative: Array) -> Array:
        """Return the deviation (n,) of all errors of points, by their group and relative noise (n,)."""
        own = self.noises[group] * relative
        return np.sqrt(own**2 + (self.drift_sds**2).sum()) if self.drifts else own

    def noise_alone(self) -> Scales:
        """Return these noise levels without any field."""
        k = self.amplitudes
        return Scales(self.log[k:], self.prior_log[k:], self.prior_log_sd[k:], self.least[k:], 0)


@dataclass(frozen=True, eq=False)
class MarginalLikelihood:
    """This is the evidence of amplitudes a and noise levels s, by their logarithms: with residuals
    z ~ N(0, K + S),

    K = fixed + sum_k a_k^2 parts_k (n, n)      and      S = diag((s of the row's group * relative)^2).
    """

    fixed: Array
    parts: list[Array]
    rows: Rows

    @classmethod
    def of(cls, covariance: Covariance, rows: Rows) -> MarginalLikelihood:
        """Return that of all amplitudes of a field, seen by rows, and of their drift."""
        fixed, parts = grams(covariance, rows.observed)
        return cls(fixed, [*parts, *rows.drift], rows)

    def covariance(self, log: Array) -> tuple[Array, Array]:
        """Return K + S (n, n), and the diagonal of S (n,)."""
        matrix = self.fixed.copy()
        for k, part in enumerate(self.parts):
            add_scaled(matrix, part, np.exp(2.0 * log[k]))
        return with_noise(matrix, log[len(self.parts) :], self.rows)

    def maximise(self, scales: Scales, settings: IterationSettings) -> Array:
        """Return the logarithms that maximise evidence times log-normal priors (MacKay 1992), by L-BFGS on
        the exact gradient.
        """
        return _minimise_energy(scales, self.rows, self._terms, settings)

    def energy(self, scales: Scales) -> float:
        """Return the -log evidence of scales, with their priors, in nats."""
        matrix, _ = self.covariance(scales.log)
        pull = (scales.log - scales.prior_log) / scales.prior_log_sd
        posterior, _ = solve(matrix, self.rows.residual)
        return free_energy(posterior, scales.log[scales.amplitudes :], self.rows) + 0.5 * float(pull @ pull)

    def pull(self, log: Array, part: Array) -> float:
        """Return by how many of its standard deviations the evidence rises with the variance of a further
        part (n, n) of the covariance, as that begins: the score test (Rao 1948).
        """
        matrix, _ = self.covariance(log)
        posterior, inverse = solve(matrix, self.rows.residual)
        share = inverse @ part
        rise = float(posterior.alpha @ part @ posterior.alpha) - float(np.trace(share))
        return rise / float(np.sqrt(2.0 * np.vdot(share, share.T)))

    def _terms(self, log: Array) -> Terms:
        matrix, noise = self.covariance(log)
        posterior, inverse = solve(matrix, self.rows.residual)
        # -2 d log p / d K = (K + S)^-1 - alpha alpha'
        slope = inverse - np.outer(posterior.alpha, posterior.alpha)
        slopes = [float(np.vdot(slope, part)) * np.exp(2.0 * log[k]) for k, part in enumerate(self.parts)]
        return posterior.energy, slopes, noise * np.diag(slope)

    def laplace(self, scales: Scales) -> float:
        """Return by how many nats the evidence at its maximum exceeds the evidence of all amplitudes and
        noise levels: Laplace's approximation with their log-normal priors and Fisher's information (Kass and
        Raftery 1995). What the points say nothing of costs nothing.
        """
        matrix, noise = self.covariance(scales.log)
        return self.laplace_of(scales, noise, solve(matrix, self.rows.residual)[1])

    def laplace_of(self, scales: Scales, noise: Array, inverse: Array) -> float:
        """Return `laplace` where the diagonal of S (n,) and (K + S)^-1 (n, n) are known."""
        of_groups = [inverse * (noise * (self.rows.group == g)) for g in range(len(scales.noises))]
        slopes = [
            np.exp(2.0 * log) * inverse @ part for log, part in zip(scales.log, self.parts, strict=False)
        ] + of_groups
        # slope_k = (K + S)^-1 d(K + S) / d log_k / 2, and Fisher's information is 2 tr(slope_k slope_l)
        information = np.zeros((len(slopes), len(slopes)))
        for k, slope in enumerate(slopes):
            turned = np.ascontiguousarray(slope.T)  # turned once, not in every product
            information[k, : k + 1] = [2.0 * np.vdot(other, turned) for other in slopes[: k + 1]]
        information += np.tril(information, -1).T
        noises = np.arange(scales.amplitudes, len(scales.log))
        information[noises, noises] += 2.0 * np.maximum(self.rows.scatter[1], 0.0)
        pull = (scales.log - scales.prior_log) / scales.prior_log_sd
        stiffer = np.eye(len(pull)) + scales.prior_log_sd[:, None] * information * scales.prior_log_sd
        return 0.5 * float(pull @ pull + np.linalg.slogdet(stiffer)[1])


def tune_noise(scales: Scales, features: Array, rows: Rows, settings: IterationSettings) -> Array:
    """Tune noise levels alone, where the covariance is that of few `features` (n, k): `fixed` is features
    features^T, and its inverse with the noise is had from a (k, k) matrix (Woodbury's identity).
    """

    def terms(log: Array) -> Terms:
        noise = _noise_variances(log, rows)
        z = rows.residual
        weighted = features / noise[:, None]
        factor = np.linalg.cholesky(np.eye(features.shape[1]) + features.T @ weighted)
        half = solve_triangular(factor, weighted.T, lower=True, check_finite=False)
        alpha = z / noise - (half @ z) @ half
        precision = 1.0 / noise - (half**2).sum(axis=0)
        energy = 0.5 * float(z @ alpha + np.log(noise).sum()) + float(np.log(np.diag(factor)).sum())
        return energy, [], noise * (precision - alpha**2)

    return _minimise_energy(scales, rows, terms, settings)


def _minimise_energy(
    scales: Scales, rows: Rows, terms: Callable[[Array], Terms], settings: IterationSettings
) -> Array:
    """Return the logarithms (k,) that minimise -log evidence. terms: those of the rows alone; those of the
    priors are added here.
    """
    squares, degrees = rows.scatter

    def objective(log: Array) -> tuple[float, Array]:
        pull = (log - scales.prior_log) / scales.prior_log_sd
        too_far = REFUSED, np.asarray(pull / scales.prior_log_sd)  # the line search comes back
        if (log - scales.log).max() > OVERFLOW:
            return too_far
        try:
            energy, of_fields, of_rows = terms(log)
        except SolverError:
            return too_far
        within = squares * np.exp(-2.0 * log[scales.amplitudes :])
        of_noises = np.bincount(rows.group, of_rows, minlength=len(squares)) - within + degrees
        energy += float(0.5 * within.sum() + degrees @ log[scales.amplitudes :]) + 0.5 * float(pull @ pull)
        return energy, np.r_[of_fields, of_noises] + pull / scales.prior_log_sd

    limits = [(low, None) for low in scales.least]
    # slopes are free of the unit of length, the energy is not: a drop relative to it would stop elsewhere in
    # metres than in millimetres
    found = minimize(
        objective,
        scales.log,
        jac=True,
        method="L-BFGS-B",
        bounds=limits,
        options={
            "maxiter": settings.tuning_steps,
            "maxcor": settings.tuning_memory,
            "ftol": 0,
            "gtol": settings.tuning_tolerance,
        },
    )
    return np.asarray(found.x)


def with_noise(matrix: Array, log: Array, rows: Rows) -> tuple[Array, Array]:
    """Return a covariance (n, n) of the field (in place) with that of noise levels, and the noise part
    (n,).
    """
    noise = _noise_variances(log, rows)
    matrix[np.diag_indices_from(matrix)] += noise
    return matrix, noise


def _noise_variances(log: Array, rows: Rows) -> Array:
    return np.asarray((np.exp(log)[rows.group] * rows.relative) ** 2)


def free_energy(posterior: Posterior, log_noise: Array, rows: Rows) -> float:
    """Return the -log evidence, in nats, of believed points: a row of weight w stands for N(z; f, s^2)^w, not
    for N(z; f, s^2 / w).
    """
    squares, degrees = rows.scatter
    within = 0.5 * float((squares * np.exp(-2.0 * log_noise)).sum()) + float(degrees @ log_noise)
    believed = len(rows.residual) + float(degrees.sum())
    return (
        posterior.energy
        - float(np.log(rows.relative).sum())
        + rows.own_noise
        + within
        + 0.5 * believed * float(np.log(2.0 * np.pi))
    )


def misfit(posterior: Posterior, log_noise: Array, rows: Rows) -> float:
    """Return the part of `free_energy` that residuals cost, in nats; what is left is the price of all that
    the fields could have explained.
    """
    return 0.5 * float(rows.residual @ posterior.alpha + (rows.scatter[0] * np.exp(-2.0 * log_noise)).sum())
