"""Prior of a field on a narrow band: a Matern covariance through its sparse precision (Lindgren, Rue,
Lindstroem 2011).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.special import gamma, k1

from ..arrays import ROUNDING, Array
from .grid.band import Band
from .grid.operators import laplacian


@dataclass(frozen=True, eq=False)
class MaternPrior:
    """Prior of a field f on the nodes of a band: 1/2 a^-2 |(kappa^2 - Laplacian) f|^2, of unit variance for a
    = 1.

    band reaches `width` to both sides of the surface; `length`: distance at which the field's correlation has
    fallen to about 0.13.
    """

    band: Band
    length: float
    amplitude: float
    operator: sparse.csr_matrix

    @classmethod
    def on(cls, band: Band, length: float, amplitude: float) -> MaternPrior:
        """The prior on a band, scaled so that a field on the surface has standard deviation `amplitude`."""
        surface_dimension = band.dimension - 1
        # smoothness nu of the Matern family: 1 on a surface, 3/2 on a curve
        order = 2.0 - 0.5 * surface_dimension
        kappa = np.sqrt(8.0 * order) / length
        variance = gamma(order) / (
            gamma(2.0) * (4.0 * np.pi) ** (0.5 * surface_dimension) * kappa ** (2.0 * order)
        )
        thickness = 2.0 * band.width  # the field is constant across the band, so its energy counts that often
        scale = np.sqrt(variance * band.spacing**band.dimension / thickness)
        operator = scale * (kappa**2 * sparse.identity(len(band), format="csr") + laplacian(band))
        return cls(band, length, amplitude, sparse.csr_matrix(operator))

    def energy(self, f: Array) -> float:
        return 0.5 * float(((self.operator @ f) ** 2).sum()) / self.amplitude**2

    def slope(self, f: Array) -> Array:
        """d energy / d f, (n,)."""
        return np.asarray(self.operator.T @ (self.operator @ f) / self.amplitude**2)


def matern(distance: Array, length: float, dimension: int) -> Array:
    """Correlation of the `MaternPrior` field at a distance, on a flat surface in `dimension` dimensions."""
    if dimension == 2:
        s = np.sqrt(12.0) * distance / length
        return np.asarray((1.0 + s) * np.exp(-s))
    s = np.maximum(np.sqrt(8.0) * distance / length, ROUNDING)
    return np.asarray(s * k1(s))
