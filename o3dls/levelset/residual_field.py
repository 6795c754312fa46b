"""Is there a field in the residuals? The marginal likelihood says whether, how long and how large, before
anything is moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from ..arrays import Array, Ints
from .matern_prior import matern

MOST = 600  # rows of the dense matrix: more points share rows by patches
PATCH = 3.0  # patches in a correlation length
RATIOS = np.geomspace(0.1, 10.0, 28)  # field amplitude over noise
NOISES = np.exp(np.linspace(-2.4, 0.6, 31))  # noise over the noise given
BELIEVED = 0.1  # points less likely than this to be on the wall say nothing of a field


@dataclass(frozen=True)
class Field:
    """A Matern field that explains residuals: correlation `length`, standard deviation `amplitude`, remaining
    noise as a `noise` factor on the noise given, and `gain`: log evidence over noise alone, in nats.
    """

    length: float
    amplitude: float
    noise: float
    gain: float

    @property
    def record(self) -> dict[str, float]:
        return {"length": self.length, "amplitude": self.amplitude, "evidence_nats": self.gain}


def evidence(feet: Array, residual: Array, weight: Array, sigma: Array, doubt: float, length: float) -> Field:
    """The best field of a given correlation length for residuals (n,) with noise sigma (n,) and weights (n,)
    at feet (n, d).

    doubt: standard deviation of the logarithm of the noise before the residuals are seen.
    """
    rows = weight > BELIEVED
    typical = float(np.median(sigma[rows]))
    precision = weight[rows] * (typical / sigma[rows]) ** 2
    patch = _patches(feet[rows], length) if rows.sum() > MOST else np.arange(rows.sum())
    total = np.bincount(patch, precision)
    mean = np.bincount(patch, precision * residual[rows]) / total
    scatter = float((precision * (residual[rows] - mean[patch]) ** 2).sum())
    at = np.column_stack([np.bincount(patch, precision * x) / total for x in feet[rows].T])
    # residuals' degrees of freedom within patches
    free = float(weight[rows].sum() * (1.0 - len(total) / rows.sum()))
    chosen = (
        np.unique(np.linspace(0, len(total) - 1, MOST).round().astype(int))
        if len(total) > MOST
        else np.arange(len(total))
    )
    return _best(at[chosen], np.sqrt(total[chosen]), mean[chosen], scatter, free, typical, doubt, length)


def _patches(feet: Array, length: float) -> Ints:
    """Number (n,) of the cube, a part of the correlation length wide, that each foot lies in."""
    cells = np.floor(feet * PATCH / length).astype(np.int64)
    return np.unique(cells - cells.min(axis=0), axis=0, return_inverse=True)[1].ravel()


def _best(
    at: Array,
    trust: Array,
    mean: Array,
    scatter: float,
    free: float,
    typical: float,
    doubt: float,
    length: float,
) -> Field:
    """Amplitude and noise that maximise the evidence on a grid, in the eigenbasis of the whitened covariance.

    mean (n,): residuals with noise `typical` / trust (n,) at positions (n, d); scatter: weighted squares
    around the means, with `free` degrees of freedom.
    """
    power, modes = np.linalg.eigh(matern(cdist(at, at), length, at.shape[1]) * trust * trust[:, None])
    shares = (modes.T @ (trust * mean)) ** 2
    ratio, noise = np.meshgrid(np.append(0.0, RATIOS), NOISES, indexing="ij")
    floor = (noise * typical) ** 2
    variance = floor[..., None] * (1.0 + ratio[..., None] ** 2 * np.maximum(power, 0.0))
    log = -0.5 * (np.log(variance) + shares / variance).sum(axis=-1) - 0.5 * (
        free * np.log(floor) + scatter / floor
    )
    log -= 0.5 * (np.log(noise) / doubt) ** 2
    best = np.unravel_index(np.argmax(log[1:]), log[1:].shape)
    factor = float(NOISES[best[1]])
    return Field(
        length, float(RATIOS[best[0]]) * factor * typical, factor, float(log[1:].max() - log[0].max())
    )
