"""Blocked leave-out predictions of the motion without a refit: from the posterior of its last round.

With C the covariance of the rows' residuals, noise included, and alpha = C^-1 z, rows B left out together
are predicted with residual [C^-1]_BB^-1 alpha_B and covariance [C^-1]_BB^-1 (Rasmussen and Williams 2006,
5.12). Feet, amplitudes, noise and beliefs stay as they were, so this is kinder than a refit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from o3dls.arrays import Array, Ints
from o3dls.estimate import Estimate
from o3dls.pipeline.cross_validation import blocks

Statistics = dict[str, Any]
BELIEVED = 3.0  # noise levels, from which on a row's own noise is that of a point that is not believed
BLOCKS = (1, 8, 16, 32)  # rows per block: alone, and neighbours together


def left_out_statistics(estimate: Estimate) -> Statistics:
    """Per size of block: mean size of the residuals (`left_8_mm`), their rms over the deviation that is
    predicted, noise included (`left_8_z`), Mahalanobis square per row (`left_8_chi`), and the worst block's
    mean (`left_8_worst_mm`).
    """
    fit = estimate.fit
    if fit is None:
        return {}
    rows = len(fit.motion.posterior.alpha) - 3 * len(fit.problem.marks)
    inverse = _inverse(fit.motion.posterior.factor)
    believed = _believed(fit, inverse, rows)
    at = fit.motion.observed.at[:rows]
    found: Statistics = {"left_rows": rows}
    for size in BLOCKS:
        count = max(1, len(believed) // size)
        chosen = [believed[rows] for rows in blocks(at[believed], np.arange(len(believed)), count)]
        found |= _of_blocks(f"left_{size}", inverse, fit.motion.posterior.alpha, chosen)
    return found


def _inverse(factor: Array) -> Array:
    from scipy.linalg import solve_triangular

    half = solve_triangular(np.tril(factor), np.eye(len(factor)), lower=True)
    return np.asarray(half.T @ half)


def _believed(fit: Any, inverse: Array, rows: int) -> Ints:
    """Rows of points that are believed: whose left-out variance is not that of a point without weight."""
    alone = 1.0 / np.sqrt(np.diag(inverse)[:rows])
    return np.flatnonzero(alone < max(BELIEVED * fit.sigma, 2.0 * float(np.median(alone))))


def _of_blocks(name: str, inverse: Array, alpha: Array, chosen: list[Ints]) -> Statistics:
    residuals, standard, chi = [], [], []
    for block in chosen:
        covariance = np.linalg.inv(inverse[np.ix_(block, block)])
        residual = covariance @ alpha[block]
        residuals.append(residual)
        standard.append(residual / np.sqrt(np.diag(covariance)))
        chi.append(float(alpha[block] @ residual) / len(block))
    every = np.abs(np.concatenate(residuals))
    worst = max(float(np.abs(one).mean()) for one in residuals)
    z = np.concatenate(standard)
    return {
        f"{name}_mm": float(every.mean()),
        f"{name}_worst_mm": worst,
        f"{name}_z": float(np.sqrt((z**2).mean())),
        f"{name}_z_q95": float(np.percentile(np.abs(z), 95)),
        f"{name}_chi": float(np.mean(chi)),
        f"{name}_chi_max": float(np.max(chi)),
    }
