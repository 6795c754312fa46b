"""The inverse of a displacement by fixed point, and where a displacement folds space."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...arrays import Array, Mask
from .settings import SETTINGS

Displacement = Callable[[Array], Array]  # of places (n, d)


class Shifted(NamedTuple):
    """These are the shifts (n, d) of an inverse, and how far (n,) each place is missed."""

    shift: Array
    residual: Array


class Inverted(NamedTuple):
    """These are places (n, d) that an inverse found, how far (n,) each misses the place that it should go to,
    and where (n,) the field folds.
    """

    places: Array
    residual: Array
    folded: Mask

    @property
    def failed(self) -> Mask:
        """Where (n,) there is no inverse, or none was found."""
        return np.asarray(self.folded | ~(self.residual <= SETTINGS.tolerance))


def fixed_point(
    displacement: Displacement,
    at: Array,
    tolerance: float = SETTINGS.tolerance,
    most: int = SETTINGS.most_steps,
) -> Shifted:
    """Return v (n, d) with v(z) = -u(z + v(z)) at places z (n, d), by repeating it, and |v + u(z + v)|.

    It converges where u is a contraction, that is, changes by less than its places are apart.
    """
    shift = -displacement(at)
    residual = np.full(len(at), np.inf)
    active = np.arange(len(at))
    for _ in range(most):
        again = -displacement(at[active] + shift[active])
        residual[active] = np.linalg.norm(again - shift[active], axis=1)
        going = residual[active] > tolerance
        shift[active[going]] = again[going]
        active = active[going]
        if not len(active):
            break
    return Shifted(shift, residual)


def determinants(displacement: Displacement, at: Array, step: float) -> Array:
    """Return the determinants (n,) of the Jacobian of x + u(x), by central differences."""
    dim = at.shape[1]
    columns = [
        axis + (displacement(at + step * axis) - displacement(at - step * axis)) / (2.0 * step)
        for axis in np.eye(dim)
    ]
    return np.asarray(np.linalg.det(np.stack(columns, axis=2)))
