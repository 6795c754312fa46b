"""The Gaussian process of the motion: what is known of the field given noisy linear observations of it.

n observations z of a field D with covariance K among them, and with noise of covariance S, give (Rasmussen
and Williams 2006, chapter 2)

    K + S = L L'                            solve
    alpha = (K + S)^-1 z                    solve
    E[D*] = K* alpha                        FieldPosterior.mean
    cov[D*] = K** - K* (K + S)^-1 K*'       FieldPosterior.covariance and variance
    -log p(z) = z' alpha / 2 + log det L    Posterior.energy, without the constant n log(2 pi) / 2

where K* and K** are covariances of what is asked with the observations and with itself (`FieldPrior`). Which
amplitudes and noise make z likely is in `marginal_likelihood`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dtrsm

from ...arrays import ROUNDING, Array
from ...cholesky import factor_and_inverse
from ...errors import SolverError
from .covariance import FieldPrior, Observed, Places


@dataclass(frozen=True)
class Posterior:
    """A posterior solves a linear system: L (n, n), lower; alpha (n,); precision (n,), the diagonal of (K +
    S)^-1; energy, the -log evidence.
    """

    factor: Array
    alpha: Array
    precision: Array
    energy: float

    def left_out(self, noise: Array) -> tuple[Array, Array]:
        """Return the residual (n,) of each observation to the fit without it, and that fit's variance there
        (n,), in closed form (Sundararajan 2001). noise (n,): the diagonal of S.
        """
        predictive = 1.0 / self.precision
        return self.alpha * predictive, np.maximum(predictive - noise, ROUNDING)

    def whitened(self, crossed: Array) -> Array:
        """Return (L^-1 crossed)' (m, n) of covariances `crossed` (n, m) with the observations."""
        return np.asarray(dtrsm(1.0, self.factor, crossed.T, side=1, lower=1, trans_a=1))  # as in memory


def solve(matrix: Array, z: Array) -> tuple[Posterior, Array]:
    """Return the posterior for residuals z (n,) with covariance `matrix` (n, n), K + S, and the matrix's
    inverse. Raises SolverError if not positive.
    """
    factor, inverse, fault = factor_and_inverse(matrix)  # K + S = L L'
    if fault:
        raise SolverError(
            f"the covariance of the residuals is not positive definite (minor {fault} of {len(z)})"
        )
    alpha = inverse @ z
    energy = 0.5 * float(z @ alpha) + float(np.log(np.diag(factor)).sum())
    if not np.isfinite(energy):
        raise SolverError("the energy of the motion is not finite: a residual or an amplitude overflowed")
    return Posterior(factor, alpha, np.diag(inverse).copy(), energy), inverse


@dataclass(frozen=True, eq=False)
class FieldPosterior:
    """This is the field after its observations: its prior, what was observed, and the posterior of these."""

    prior: FieldPrior
    observed: Observed
    solved: Posterior

    def mean(self, places: Places) -> Array:
        """Return the expected displacement (m, d) at places: K* alpha."""
        return self.prior.displacement(self.observed, self.solved.alpha, places)

    def variance(self, asked: Observed) -> Array:
        """Return the variance (m,) of what is asked: the diagonal of `covariance`."""
        explained = self.solved.whitened(self.prior.between(self.observed, asked))
        less = self.prior.variance(asked) - np.einsum("mn,mn->m", explained, explained)
        return np.asarray(np.maximum(less, 0.0))

    def covariance(self, asked: Observed) -> Array:
        """Return the covariance (m, m) of what is asked: K** - K* (K + S)^-1 K*'."""
        explained = self.solved.whitened(self.prior.between(self.observed, asked))
        return self.prior.between(asked, asked) - explained @ explained.T
