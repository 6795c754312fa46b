"""Likelihood of signed distances: Gaussian around the wall or, rarely, an outlier, which as a rule lies
inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..arrays import Array
from .contact import Contact


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood describes the noise of points around a surface: sd `sigma` (n,) each, and outliers as
    `contact` expects them.

    In logarithms: with an outlier fraction of 0, a point however far off is still one of the wall.

    one_sided (n,): points known to be inside only; they are free inside and pay outside. Distances are
    signed, negative inside.
    """

    sigma: Array
    contact: Contact
    one_sided: NDArray[np.bool_]

    def loss(self, distance: Array) -> Array:
        """Return -log p (n,) of signed distances (n,)."""
        return losses(distance, *self.numbers)  # type: ignore[no-any-return]

    @cached_property
    def numbers(self) -> tuple[Array, NDArray[np.bool_], float, float, float]:
        """What `losses` are computed from."""
        outside, inside = self.contact.outlier_density(np.array([1.0, -1.0]))
        return self.sigma, self.one_sided, float(self.contact.outlier_fraction), float(outside), float(inside)


@njit(cache=True, nogil=True)
def losses(distance, sigma, one_sided, fraction, outside, inside):  # type: ignore[no-untyped-def]
    """Return -log p (n,) of signed distances (n,): outliers, a `fraction` of all, have the densities
    `outside` and `inside`; being inside is no fault of those known to be.
    """
    loss = np.empty(len(distance))
    for i in range(len(distance)):
        free = one_sided[i] and distance[i] < 0.0
        off = 0.0 if free else distance[i] / sigma[i]
        touching = np.log((1.0 - fraction) / (np.sqrt(2.0 * np.pi) * sigma[i])) - 0.5 * off * off
        density = inside if distance[i] < 0.0 and not one_sided[i] else outside
        loss[i] = -np.logaddexp(touching, np.log(fraction * density))
    return loss
