"""Is there a field in the residuals? The marginal likelihood says whether, how long and how large, before
anything is moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from ..arrays import Array, Ints
from .matern_prior import matern
from .settings import FieldSettings


@dataclass(frozen=True)
class ResidualField:
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


def residual_field(
    feet: Array,
    residual: Array,
    weight: Array,
    sigma: Array,
    sigma_log_sd: float,
    length: float,
    settings: FieldSettings | None = None,
) -> ResidualField:
    """The best field of a given correlation length for residuals (n,) with noise sigma (n,) and weights (n,)
    at feet (n, d).

    sigma_log_sd: standard deviation of the logarithm of the noise before the residuals are seen.
    """
    settings = settings or FieldSettings()
    rows = weight > settings.least_belief
    typical = float(np.median(sigma[rows]))
    precision = weight[rows] * (typical / sigma[rows]) ** 2
    patch = (
        _patches(feet[rows], length / settings.patches)
        if rows.sum() > settings.most_rows
        else np.arange(rows.sum())
    )
    total = np.bincount(patch, precision)
    mean = np.bincount(patch, precision * residual[rows]) / total
    scatter = float((precision * (residual[rows] - mean[patch]) ** 2).sum())
    at = np.column_stack([np.bincount(patch, precision * x) / total for x in feet[rows].T])
    # residuals' degrees of freedom within patches
    free = float(weight[rows].sum() * (1.0 - len(total) / rows.sum()))
    chosen = (
        np.unique(np.linspace(0, len(total) - 1, settings.most_rows).round().astype(int))
        if len(total) > settings.most_rows
        else np.arange(len(total))
    )
    whitened = Whitened(at[chosen], np.sqrt(total[chosen]), mean[chosen], scatter, free, typical)
    return _best(whitened, sigma_log_sd, length, settings)


def _patches(feet: Array, width: float) -> Ints:
    """Number (n,) of the cube of a width that each foot lies in."""
    cells = np.floor(feet / width).astype(np.int64)
    return np.unique(cells - cells.min(axis=0), axis=0, return_inverse=True)[1].ravel()


@dataclass(frozen=True, eq=False)
class Whitened:
    """Residuals (n,) with noise `sigma` / trust (n,) at positions (n, d); scatter: weighted squares around
    the means of patches, with `free` degrees of freedom.
    """

    at: Array
    trust: Array
    mean: Array
    scatter: float
    free: float
    sigma: float


def _best(seen: Whitened, sigma_log_sd: float, length: float, settings: FieldSettings) -> ResidualField:
    """Amplitude and noise that maximise the evidence on a grid, in the eigenbasis of the whitened
    covariance.
    """
    at, trust, sigma = seen.at, seen.trust, seen.sigma
    ratios = np.geomspace(*settings.amplitudes)
    noises = np.exp(np.linspace(*settings.noise_logs))
    power, modes = np.linalg.eigh(matern(cdist(at, at), length, at.shape[1]) * trust * trust[:, None])
    squares = (modes.T @ (trust * seen.mean)) ** 2
    ratio, noise = np.meshgrid(np.append(0.0, ratios), noises, indexing="ij")
    floor = (noise * sigma) ** 2
    variance = floor[..., None] * (1.0 + ratio[..., None] ** 2 * np.maximum(power, 0.0))
    log = -0.5 * (np.log(variance) + squares / variance).sum(axis=-1) - 0.5 * (
        seen.free * np.log(floor) + seen.scatter / floor
    )
    log -= 0.5 * (np.log(noise) / sigma_log_sd) ** 2
    best = np.unravel_index(np.argmax(log[1:]), log[1:].shape)
    factor = float(noises[best[1]])
    return ResidualField(
        length, float(ratios[best[0]]) * factor * sigma, factor, float(log[1:].max() - log[0].max())
    )
