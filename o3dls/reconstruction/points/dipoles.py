"""The winding number of many dipoles, and the direction in which it falls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ...arrays import Array, Ints
from ...motion.field.covariance import WORTH
from ...parallel import by_rows


@dataclass(frozen=True, eq=False)
class DipolePlaces:
    """Dipoles stand at these places (m, 3), and those in a cell are seen as one from a distance of `far` on:
    their order by cell, the first (cells + 1,) of each in that order, and the cells' middles.
    """

    places: Array
    far: float
    order: Ints
    first: Ints
    middles: Array

    @classmethod
    def of(cls, places: Array, width: float, far: float) -> DipolePlaces:
        cell = cells(places, width)
        order = np.argsort(cell, kind="stable")
        number = np.bincount(cell)
        middles = np.column_stack([np.bincount(cell, x) / number for x in places.T])
        return cls(places[order], far, order, np.r_[0, np.cumsum(number)], middles)

    def winding(self, at: Array, dipoles: Array, smoothing: Array) -> tuple[Array, Array]:
        """Return the direction (n, 3), times a density, in which the winding number of dipoles (m, 3), each
        spread over a length (m,), falls at places (n, 3), and that number (n,): 1 inside.
        """
        dipoles, width2 = dipoles[self.order], smoothing[self.order] ** 2
        whole = np.add.reduceat(dipoles, self.first[:-1])
        wide = np.add.reduceat(width2, self.first[:-1]) / np.diff(self.first)
        fall, number = np.zeros_like(at), np.zeros(len(at))
        near = (self.places, dipoles, width2, self.first)
        far = (self.middles, whole, wide, self.far**2)
        by_rows(_fill_winding, WORTH, (at, fall, number), *near, *far)
        return fall, number


def cells(points: Array, width: float) -> Ints:
    """Return the cell (n,) of a width that each point (n, 3) lies in, numbered."""
    return np.unique(np.floor(points / width).astype(np.int64), axis=0, return_inverse=True)[1].ravel()


@njit(cache=True, nogil=True, fastmath=True)
def _fill_winding(  # type: ignore[no-untyped-def]
    places, fall, number, at, dipoles, width2, first, middles, whole, wide, far2
):
    """Fill in the fall and the winding number that `DipolePlaces.winding` returns."""
    for i in range(len(places)):
        fall[i] = 0.0
        total = 0.0
        for k in range(len(middles)):
            apart = (
                (places[i, 0] - middles[k, 0]) ** 2
                + (places[i, 1] - middles[k, 1]) ** 2
                + (places[i, 2] - middles[k, 2]) ** 2
            )
            if apart > far2:
                total += _add_dipole(fall, places, i, middles, whole, wide, k)
            else:
                for j in range(first[k], first[k + 1]):
                    total += _add_dipole(fall, places, i, at, dipoles, width2, j)
        number[i] = total / (4.0 * np.pi)


@njit(cache=True, nogil=True, fastmath=True)
def _add_dipole(fall, places, i, at, dipoles, width2, j):  # type: ignore[no-untyped-def]
    """Return the solid angle of dipole j at place i, and add its fall to `fall`."""
    x = places[i, 0] - at[j, 0]
    y = places[i, 1] - at[j, 1]
    z = places[i, 2] - at[j, 2]
    squared = x * x + y * y + z * z + width2[j]
    inverse = 1.0 / (squared * np.sqrt(squared))
    across = dipoles[j, 0] * x + dipoles[j, 1] * y + dipoles[j, 2] * z
    along = 3.0 * across / squared
    fall[i, 0] += (dipoles[j, 0] - along * x) * inverse
    fall[i, 1] += (dipoles[j, 1] - along * y) * inverse
    fall[i, 2] += (dipoles[j, 2] - along * z) * inverse
    return -across * inverse
