"""Is there a field in the residuals? The marginal likelihood says whether, how long and how large, before anything is moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from ..geometry import Array
from .energy import matern

MOST = 600  # points that the evidence looks at: a dense matrix of all of 20 000 would not pay
RATIOS = np.geomspace(0.1, 10.0, 28)  # field amplitude over noise
NOISES = np.exp(np.linspace(-2.4, 0.6, 31))  # noise over the noise given
BELIEVED = 0.1  # points less likely than this to be on the wall say nothing of a field


@dataclass(frozen=True)
class Field:
    """A Matern field that explains residuals: correlation `length`, standard deviation `amplitude`, remaining noise as a
    `noise` factor on the noise given, and `gain`: log evidence over noise alone, in nats."""

    length: float
    amplitude: float
    noise: float
    gain: float

    @property
    def record(self) -> dict[str, float]:
        return {"length": self.length, "amplitude": self.amplitude, "evidence_nats": self.gain}


def evidence(feet: Array, residual: Array, weight: Array, sigma: Array, doubt: float, length: float) -> Field:
    """The best field of a given correlation length for residuals (n,) with noise sigma (n,) and weights (n,) at feet (n, d).

    doubt: standard deviation of the logarithm of the noise before the residuals are seen.
    """
    rows = np.flatnonzero(weight > BELIEVED)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, MOST).round().astype(int))] if len(rows) > MOST else rows
    typical = float(np.median(sigma[rows]))
    trust = np.sqrt(weight[rows]) * typical / sigma[rows]
    covariance = matern(cdist(feet[rows], feet[rows]), length, feet.shape[1]) * trust * trust[:, None]
    power, modes = np.linalg.eigh(covariance)
    shares = (modes.T @ (trust * residual[rows])) ** 2
    ratio, noise = (g[..., None] for g in np.meshgrid(np.append(0.0, RATIOS), NOISES, indexing="ij"))
    variance = (noise * typical) ** 2 * (1.0 + ratio**2 * np.maximum(power, 0.0))
    log = -0.5 * (np.log(variance) + shares / variance).sum(axis=-1) - 0.5 * (np.log(NOISES) / doubt) ** 2
    at = np.unravel_index(np.argmax(log[1:]), log[1:].shape)
    factor = float(NOISES[at[1]])
    return Field(length, float(RATIOS[at[0]]) * factor * typical, factor, float(log[1:].max() - log[0].max()))
