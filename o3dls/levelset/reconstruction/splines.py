"""A smooth field in space: quadratic B-splines on lattices, each half as wide as the one before.

Their coefficients are independent before points are seen, which makes a field of many lengths (Nychka et al.
2015), and only those next to a point can differ from 0 after: cost grows with the points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy import sparse

from ...arrays import Array, Ints

VARIANCE = 0.55**3  # of a field of unit coefficients: the mean of the squares of a spline's values, per axis


@dataclass(frozen=True, eq=False)
class SplineLattice:
    """Splines of a width `spacing` next to points: their places in a box that begins at lattice index `low`
    (3,), as columns, -1 where there is none.
    """

    spacing: float
    low: Ints
    columns: Ints
    count: int

    @classmethod
    def around(cls, points: Array, spacing: float) -> SplineLattice:
        """All splines that do not vanish at one of the points (n, 3)."""
        base = np.round(points / spacing).astype(np.int64)
        low = base.min(axis=0) - 1
        taken = np.zeros(base.max(axis=0) - low + 2, dtype=bool)
        for step in np.ndindex(3, 3, 3):
            taken[tuple((base - low + step - 1).T)] = True
        columns = np.full(taken.shape, -1)
        count = int(taken.sum())
        columns[taken] = np.arange(count)
        return cls(spacing, low, columns, count)

    def rows(self, points: Array) -> tuple[sparse.csr_matrix, list[sparse.csr_matrix]]:
        """Values at points (n, 3) that the lattice was made around, a matrix (n, count), and the three of
        derivatives.
        """
        scaled = points / self.spacing
        base = np.round(scaled).astype(np.int64)
        value, slope = _splines(scaled - base)
        steps = np.array(list(np.ndindex(3, 3, 3)))
        at = base[:, None, :] - self.low + steps - 1
        inside = ((at >= 0) & (at < self.columns.shape)).all(axis=2)
        column = np.where(
            inside, self.columns[tuple(np.moveaxis(np.where(inside[..., None], at, 0), 2, 0))], -1
        )
        known = column >= 0
        pointer = np.r_[0, np.cumsum(known.sum(axis=1))]

        def matrix(x: Array, y: Array, z: Array) -> sparse.csr_matrix:
            products = x[:, steps[:, 0]] * y[:, steps[:, 1]] * z[:, steps[:, 2]]
            return sparse.csr_matrix(
                (products[known], column[known], pointer), shape=(len(points), self.count)
            )

        x, y, z = np.moveaxis(value, 1, 0)
        dx, dy, dz = np.moveaxis(slope, 1, 0) / self.spacing
        return matrix(x, y, z), [matrix(dx, y, z), matrix(x, dy, z), matrix(x, y, dz)]


@dataclass(frozen=True, eq=False)
class SplineField:
    """A field: lattices with a coefficient per spline."""

    lattices: Sequence[SplineLattice]
    coefficients: Sequence[Array]

    def at(self, points: Array) -> Array:
        """Values (n,) at points (n, 3)."""
        total = np.zeros(len(points))
        for lattice, values in zip(self.lattices, self.coefficients, strict=True):
            _add(total, points / lattice.spacing, lattice.low, lattice.columns, values)
        return total


def _splines(part: Array) -> tuple[Array, Array]:
    """Values and derivatives of the three splines around, (..., 3), for places in [-1/2, 1/2] of a node."""
    left, right = 0.5 - part, 0.5 + part
    value = np.stack([0.5 * left**2, 0.75 - part**2, 0.5 * right**2], axis=-1)
    return value, np.stack([-left, -2.0 * part, right], axis=-1)


@njit(cache=True)
def _add(total, scaled, low, columns, values):  # type: ignore[no-untyped-def]
    """Add the sum of the splines at scaled points (n, 3) to `total` (n,)."""
    weights = np.empty((3, 3))
    base = np.empty(3, np.int64)
    for i in range(len(scaled)):
        for axis in range(3):
            node = np.round(scaled[i, axis])
            part = scaled[i, axis] - node
            base[axis] = np.int64(node) - low[axis] - 1
            weights[axis, 0] = 0.5 * (0.5 - part) ** 2
            weights[axis, 1] = 0.75 - part * part
            weights[axis, 2] = 0.5 * (0.5 + part) ** 2
        for a in range(3):
            x = base[0] + a
            if x < 0 or x >= columns.shape[0]:
                continue
            for b in range(3):
                y = base[1] + b
                if y < 0 or y >= columns.shape[1]:
                    continue
                for c in range(3):
                    z = base[2] + c
                    if 0 <= z < columns.shape[2] and columns[x, y, z] >= 0:
                        weight = weights[0, a] * weights[1, b] * weights[2, c]
                        total[i] += weight * values[columns[x, y, z]]
