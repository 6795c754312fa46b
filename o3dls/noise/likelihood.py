"""Likelihood of signed distances: Gaussian around the wall or, rarely, an outlier, which as a rule lies
inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array

# how far outliers scatter, in rms radii of the prior: 15 and 30 mm for an atrium
INNER_DEPTH, OUTER_REACH = (
    0.6,
    1.2,
)


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Noise of points around a surface: sd `sigma` (n,) each, outliers with probability `share` over the rms
    `radius` of the prior, of them the share `inside` inside, the rest anywhere.

    In logarithms: with a share of 0, a point however far off is still one of the wall.

    one_sided (n,): points known to be inside only; they are free inside and pay outside. Distances are
    signed, negative inside.
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
        """1 where a point pulls at the surface; 0 where it is satisfied, inside and known to be inside
        only.
        """
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
