"""A smooth field in space: quadratic B-splines on lattices, each half as wide as the one before.

Their coefficients are independent before points are seen, which makes a field of many lengths (Nychka et al.
2015), and only those next to a point can differ from 0 after: cost grows with the points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from ...arrays import Array, Ints
from ...motion.field.covariance import WORTH
from ...parallel import by_rows

VARIANCE = 0.55**3  # variance of a field of unit coefficients: the mean square of a spline, per axis


@dataclass(frozen=True, eq=False)
class SplineLattice:
    """A lattice has splines of a width `spacing` next to points: their places in a box that begins at lattice
    index `low` (3,), as columns, -1 where there is none.
    """

    spacing: float
    low: Ints
    columns: Ints
    count: int

    @classmethod
    def around(cls, points: Array, spacing: float) -> SplineLattice:
        """Make a lattice of all splines that do not vanish at one of the points (n, 3)."""
        base = np.round(points / spacing).astype(np.int64)
        low = base.min(axis=0) - 1
        taken = np.zeros(base.max(axis=0) - low + 2, dtype=bool)
        for step in np.ndindex(3, 3, 3):
            taken[tuple((base - low + step - 1).T)] = True
        columns = np.full(taken.shape, -1)
        count = int(taken.sum())
        columns[taken] = np.arange(count)
        return cls(spacing, low, columns, count)

    def rows(self, points: Array) -> SplineRows:
        """Return the splines at points (n, 3) that the lattice was made around."""
        scaled = points / self.spacing
        base = np.round(scaled).astype(np.int64)
        value, slope = _spline_values(scaled - base)
        steps = np.array(list(np.ndindex(3, 3, 3)))
        at = base[:, None, :] - self.low + steps - 1
        columns = self.columns[tuple(np.moveaxis(at, 2, 0))].astype(np.int32)
        return SplineRows(self.count, columns, value, slope / self.spacing)

    def along(self, axis: int, scaled: Array) -> Array:
        """Return the values (n, k) of the lattice's k splines along one axis, at scaled coordinates (n,)."""
        base = np.round(scaled)
        value, _ = _spline_values(scaled - base)
        columns = base.astype(np.int64)[:, None] - self.low[axis] + np.arange(-1, 2)
        there = (columns >= 0) & (columns < self.columns.shape[axis])
        out = np.zeros((len(scaled), self.columns.shape[axis]))
        out[np.nonzero(there)[0], columns[there]] = value[there]
        return out


@dataclass(frozen=True, eq=False)
class SplineRows:
    """Each row has the 27 splines next to one of n points, of `count` in all: their columns (n, 27), and
    values and derivatives (n, 3, 3) by axis and spline. What they make of coefficients: value and gradient,
    four numbers a point.
    """

    count: int
    columns: Ints
    value: Array
    slope: Array

    def of(self, coefficients: Array) -> Array:
        """Return the value and gradient (n, 4) of a field."""
        out = np.empty((len(self.columns), 4))
        _contract_axes(self.columns, self.value, self.slope, out, np.ascontiguousarray(coefficients))
        return out

    def back(self, values: Array) -> Array:
        """Return the transposed map: coefficients (count,) of values and gradients (n, 4)."""
        total = np.zeros(self.count)
        _add_transpose(self.columns, self.value, self.slope, values, total)
        return total

    def squares(self, weights: Array) -> Array:
        """Return the sums (count,) of the map's squared entries, weighted (n, 4): the diagonal of the normal
        matrix.
        """
        total = np.zeros(self.count)
        _add_squares(self.columns, self.value, self.slope, weights, total)
        return total


@dataclass(frozen=True, eq=False)
class SplineField:
    """A field has lattices with a coefficient per spline."""

    lattices: Sequence[SplineLattice]
    coefficients: Sequence[Array]

    def at(self, points: Array) -> Array:
        """Return the values (n,) at points (n, 3)."""
        total = np.zeros(len(points))
        for lattice, values in zip(self.lattices, self.coefficients, strict=True):
            rows = total, points / lattice.spacing
            by_rows(_add_splines, WORTH, rows, lattice.low, lattice.columns, values)
        return total

    def on_box(self, low: Ints, shape: tuple[int, ...], spacing: float) -> Array:
        """Return the values on the nodes (index + low) * spacing of a box, one axis after the other."""
        total = np.zeros(shape)
        for lattice, values in zip(self.lattices, self.coefficients, strict=True):
            field = np.where(lattice.columns >= 0, values[lattice.columns], 0.0)
            for axis, count in enumerate(shape):
                scaled = (np.arange(count) + low[axis]) * spacing / lattice.spacing
                along = lattice.along(axis, scaled)
                field = np.moveaxis(np.tensordot(along, field, (1, axis)), 0, axis)
            total += field
        return total


def _spline_values(part: Array) -> tuple[Array, Array]:
    """Return values and derivatives of the three splines around places in [-1/2, 1/2] of a node, (..., 3)."""
    left, right = 0.5 - part, 0.5 + part
    value = np.stack([0.5 * left**2, 0.75 - part**2, 0.5 * right**2], axis=-1)
    return value, np.stack([-left, -2.0 * part, right], axis=-1)


@njit(cache=True, nogil=True)
def _add_splines(total, scaled, low, columns, values):  # type: ignore[no-untyped-def]
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


@njit(cache=True, nogil=True)
def _contract_axes(columns, value, slope, out, coefficients):  # type: ignore[no-untyped-def]
    """Write the value and gradient (n, 4) at each point, by contracting one axis after the other."""
    for i in range(len(columns)):
        v = gx = gy = gz = 0.0
        for a in range(3):
            p = q = s = 0.0
            for b in range(3):
                along = steep = 0.0
                for c in range(3):
                    x = coefficients[columns[i, 9 * a + 3 * b + c]]
                    along += x * value[i, 2, c]
                    steep += x * slope[i, 2, c]
                p += value[i, 1, b] * along
                q += slope[i, 1, b] * along
                s += value[i, 1, b] * steep
            v += value[i, 0, a] * p
            gx += slope[i, 0, a] * p
            gy += value[i, 0, a] * q
            gz += value[i, 0, a] * s
        out[i, 0] = v
        out[i, 1] = gx
        out[i, 2] = gy
        out[i, 3] = gz


@njit(cache=True, nogil=True)
def _add_transpose(columns, value, slope, values, total):  # type: ignore[no-untyped-def]
    """Add the transpose of `_contract_axes` to `total` (count,)."""
    for i in range(len(columns)):
        for a in range(3):
            p = value[i, 0, a] * values[i, 0] + slope[i, 0, a] * values[i, 1]
            q = value[i, 0, a] * values[i, 2]
            s = value[i, 0, a] * values[i, 3]
            for b in range(3):
                along = p * value[i, 1, b] + q * slope[i, 1, b]
                steep = s * value[i, 1, b]
                for c in range(3):
                    total[columns[i, 9 * a + 3 * b + c]] += along * value[i, 2, c] + steep * slope[i, 2, c]


@njit(cache=True, nogil=True)
def _add_squares(columns, value, slope, weights, total):  # type: ignore[no-untyped-def]
    """Add the weighted squares of the entries of `_contract_axes` to `total` (count,)."""
    for i in range(len(columns)):
        for a in range(3):
            p = value[i, 0, a] ** 2 * weights[i, 0] + slope[i, 0, a] ** 2 * weights[i, 1]
            q = value[i, 0, a] ** 2 * weights[i, 2]
            s = value[i, 0, a] ** 2 * weights[i, 3]
            for b in range(3):
                along = p * value[i, 1, b] ** 2 + q * slope[i, 1, b] ** 2
                steep = s * value[i, 1, b] ** 2
                for c in range(3):
                    square = along * value[i, 2, c] ** 2 + steep * slope[i, 2, c] ** 2
                    total[columns[i, 9 * a + 3 * b + c]] += square


@njit(cache=True, nogil=True)
def correlation(a, b, lengths):  # type: ignore[no-untyped-def]
    """Return about how a field of splines of several lengths correlates at two places: a mean of
    Gaussians.
    """
    squared = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
    total = 0.0
    for k in range(len(lengths)):
        total += np.exp(-squared / lengths[k] ** 2)
    return total / len(lengths)
