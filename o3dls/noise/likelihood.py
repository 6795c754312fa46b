"""Likelihood of signed distances: Gaussian around the wall or, rarely, an outlier, which as a rule lies
inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from .contact import Contact


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Noise of points around a surface: sd `sigma` (n,) each, and outliers as `contact` expects them.

    In logarithms: with an outlier fraction of 0, a point however far off is still one of the wall.

    one_sided (n,): points known to be inside only; they are free inside and pay outside. Distances are
    signed, negative inside.
    """

    sigma: Array
    contact: Contact
    one_sided: NDArray[np.bool_]

    def loss(self, distance: Array) -> Array:
        """-log p (n,) of signed distances (n,)."""
        return np.asarray(-np.logaddexp(self._touching(distance), self._floating(distance)))

    def weight(self, distance: Array) -> Array:
        """Probability (n,) that a point is no outlier, at signed distances (n,)."""
        touching = self._touching(distance)
        return np.asarray(np.exp(touching - np.logaddexp(touching, self._floating(distance))))

    def slope(self, distance: Array) -> Array:
        """d loss / d distance, (n,)."""
        return np.asarray(self.weight(distance) * self.pull(distance) * distance / self.sigma**2)

    def pull(self, distance: Array) -> Array:
        """1 where a point pulls at the surface; 0 where it is satisfied, inside and known to be inside
        only.
        """
        return np.asarray(np.where(self.one_sided & (distance < 0.0), 0.0, 1.0))

    def _touching(self, distance: Array) -> Array:
        """log p (n,) of the points as ones of the wall."""
        wall = -0.5 * self.pull(distance) * (distance / self.sigma) ** 2
        prior = (1.0 - self.contact.outlier_fraction) / (np.sqrt(2.0 * np.pi) * self.sigma)
        return np.asarray(wall + np.log(prior))

    def _floating(self, distance: Array) -> Array:
        """log p (n,) of the points as outliers; being inside is no fault of those known to be."""
        if self.contact.outlier_fraction == 0.0:
            return np.full(len(distance), -np.inf)
        anywhere = np.full(len(distance), self.contact.anywhere)
        density = np.where(self.one_sided, anywhere, self.contact.outlier_density(distance))
        return np.asarray(np.log(self.contact.outlier_fraction * density))
