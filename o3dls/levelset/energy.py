"""The terms of E(phi, T): what the points say (a robust likelihood), and what the prior says (a second-order field on a narrow band).

    E(u) = sum_i -log p(p_i | surface) + 1/2 a^-2 |(kappa^2 - Laplacian) f|^2,    u = doubt * f,    phi = psi.T - u

u is the correction of the deformed prior along its outward normals. The likelihood of a point is Gaussian around the wall or, rarely, an
outlier, which as a rule lies inside (a catheter in the blood). The field has a Matern covariance (Lindgren, Rue, Lindstroem
2011); its order is two because point values have no hold on a field of order one on a surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.special import gamma, k1

from ..geometry import Array
from .grid import Band
from .operators import laplacian

INNER_DEPTH, OUTER_REACH = 0.6, 1.2  # how far outliers scatter, in rms radii of the prior: 15 and 30 mm for an atrium


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Noise of points around a surface: sd `sigma` (n,) each, outliers with probability `share` over the rms `radius` of the prior,
    of them the share `inside` inside, the rest anywhere.

    In logarithms: with a share of 0, a point however far off is still one of the wall.

    one_sided (n,): points known to be inside only; they are free inside and pay outside. Distances are signed, negative inside.
    """

    sigma: Array
    share: float
    radius: float
    one_sided: NDArray[np.bool_]
    inside: float

    def loss(self, distance: Array) -> Array:
        """-log p (n,) of signed distances (n,)."""
        return np.asarray(-np.logaddexp(self._good(distance), self._outlying(distance)))

    def weight(self, distance: Array) -> Array:
        """Probability (n,) that a point is no outlier, at signed distances (n,)."""
        good = self._good(distance)
        return np.asarray(np.exp(good - np.logaddexp(good, self._outlying(distance))))

    def slope(self, distance: Array) -> Array:
        """d loss / d distance, (n,)."""
        return np.asarray(self.weight(distance) * self.pull(distance) * distance / self.sigma**2)

    def pull(self, distance: Array) -> Array:
        """1 where a point pulls at the surface; 0 where it is satisfied, inside and known to be inside only."""
        return np.asarray(np.where(self.one_sided & (distance < 0.0), 0.0, 1.0))

    def _good(self, distance: Array) -> Array:
        """log p (n,) of the points as ones of the wall."""
        wall = -0.5 * self.pull(distance) * (distance / self.sigma) ** 2
        return np.asarray(wall + np.log((1.0 - self.share) / (np.sqrt(2.0 * np.pi) * self.sigma)))

    def _outlying(self, distance: Array) -> Array:
        """log p (n,) of the points as outliers."""
        if self.share == 0.0:
            return np.full(len(distance), -np.inf)
        inner = np.where(distance < 0.0, self.inside / (INNER_DEPTH * self.radius), 0.0)
        inner = np.where(self.one_sided, 0.0, inner)  # being inside is no fault of theirs
        return np.asarray(np.log(self.share * (inner + (1.0 - self.inside) / (OUTER_REACH * self.radius))))


@dataclass(frozen=True, eq=False)
class MaternPrior:
    """Prior of a field f on the nodes of a band: 1/2 a^-2 |(kappa^2 - Laplacian) f|^2, of unit variance for a = 1.

    band reaches `width` to both sides of the surface; `length`: distance at which the field's correlation has fallen to about 0.13.
    """

    band: Band
    length: float
    amplitude: float
    operator: sparse.csr_matrix

    @classmethod
    def on(cls, band: Band, length: float, amplitude: float) -> MaternPrior:
        """The prior on a band, scaled so that a field on the surface has standard deviation `amplitude`."""
        surface_dimension = band.dimension - 1
        order = 2.0 - 0.5 * surface_dimension  # smoothness nu of the Matern family: 1 on a surface, 3/2 on a curve
        kappa = np.sqrt(8.0 * order) / length
        variance = gamma(order) / (gamma(2.0) * (4.0 * np.pi) ** (0.5 * surface_dimension) * kappa ** (2.0 * order))
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
    s = np.maximum(np.sqrt(8.0) * distance / length, 1e-8)
    return np.asarray(s * k1(s))
