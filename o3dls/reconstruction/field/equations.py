"""The linear least-squares problem of the field: values, normals, and signs off the wall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg
from scipy.spatial import KDTree

from ...arrays import TINY, Array, Ints, Mask
from ..settings import SplineSettings
from .moved_prior import MovedPrior
from .splines import VARIANCE, SplineField, SplineLattice, SplineRows

NEAREST = 8  # points whose distance tells how much of the wall a point stands for


@dataclass(frozen=True, eq=False)
class Oriented:
    """Oriented points show a wall as heights (n,) along outward normals (n, 3) over their feet (n, 3), places
    near the wall; by how much each normal may be off (n,) in radians, beyond what is usual; whether (n,) the
    neighbours lie in a plane, so that the normal shows where the wall looks; the noise (n,) of each point,
    the probability (n,) that it touches, and the deviation (n,) of the field there before points are seen;
    and the number (n,) of those with which it may share an error.

    Noise moves a point along the normal too: a field that is read where the points are follows it.
    """

    feet: Array
    heights: Array
    normals: Array
    tilt: Array
    flat: Mask
    noise: Array
    weights: Array
    amplitude: Array
    stretch: Ints

    @property
    def points(self) -> Array:
        """Where they were measured (n, 3)."""
        return self.feet + self.heights[:, None] * self.normals

    def of(self, rows: Mask) -> Oriented:
        """Return the points of a mask (n,)."""
        return Oriented(*(values[rows] for values in vars(self).values()))

    def nearer(self, distance: Array) -> Oriented:
        """Return these points with their feet moved by signed distances (n,) to a wall."""
        return replace(
            self, feet=self.feet - distance[:, None] * self.normals, heights=self.heights + distance
        )


@dataclass(frozen=True, eq=False)
class OffSurface:
    """These places (k, 3) lie off the wall, where phi is known: values (k,), their noise (k,) and weights
    (k,), and the deviation (k,) of the field beforehand.
    """

    at: Array
    values: Array
    noise: Array
    weights: Array
    amplitude: Array

    def joined(self, other: OffSurface) -> OffSurface:
        """Join these places with others."""
        both = zip(vars(self).values(), vars(other).values(), strict=True)
        return OffSurface(*(np.concatenate(pair) for pair in both))


def turned_off(wall: Oriented, prior: MovedPrior, settings: SplineSettings) -> Mask:
    """Return which points (n,) lie in a plane with another normal than the moved prior next to them."""
    cosine = (prior.slope(wall.feet) * wall.normals).sum(axis=1)
    return np.asarray(wall.flat & (cosine < settings.offset_cosine))


def off_prior(wall: Oriented, prior: MovedPrior, settings: SplineSettings) -> Mask:
    """Return which points (n,) show a wall off the moved prior's, or one that looks elsewhere."""
    off = _find_off_wall(wall, prior, settings)
    return off & ~_find_floating(wall, off, prior, settings)


def floating(wall: Oriented, prior: MovedPrior, settings: SplineSettings) -> Mask:
    """Return which points (n,) inside the moved prior show no wall, many as they may be: the wall in front of
    them has points of its own.
    """
    return _find_floating(wall, _find_off_wall(wall, prior, settings), prior, settings)


def _find_off_wall(wall: Oriented, prior: MovedPrior, settings: SplineSettings) -> Mask:
    """Find the points (n,) that lie off the moved prior's wall, or whose normal differs from its, if most
    points around them do so too: a single such point is more likely an outlier.
    """
    turned = turned_off(wall, prior, settings)
    off = (np.abs(wall.heights + prior.at(wall.feet)) > settings.offset_noise * wall.noise) | turned
    around = KDTree(wall.feet).query(wall.feet, k=min(settings.offset_neighbours, len(off)))[1]
    return np.asarray(off & (off[around].mean(axis=1) > 0.5))


def _find_floating(wall: Oriented, apart: Mask, prior: MovedPrior, settings: SplineSettings) -> Mask:
    rows = np.flatnonzero(apart & (prior.at(wall.points) < 0.0))
    on_prior = wall.feet[(wall.weights > 0.5) & ~apart]
    floats = np.zeros(len(apart), dtype=bool)
    if len(rows) and len(on_prior):
        at = wall.points[rows]
        between = np.sqrt(prior.surface.area / len(apart))
        floats[rows] = KDTree(on_prior).query(prior.tree.query(at)[2])[0] < settings.covered * between
    return floats


def off_surface(
    wall: Oriented, off: Mask, prior: MovedPrior, radius: float, settings: SplineSettings
) -> OffSurface:
    """Put known values of phi on both sides of the points that are `off` (n,) the moved prior: what was wall
    there is none, and what was not inside is (Carr et al. 2001). Places that other points are nearer to are
    left out.
    """
    rows = np.flatnonzero(off)
    near = KDTree(wall.feet)
    places, values, noise, weights, amplitude = [], [], [], [], []
    for offset in radius * np.asarray(settings.offsets):
        for side in (1.0, -1.0):
            at = wall.feet[rows] + side * offset * wall.normals[rows]
            clear = near.query(at)[0] > settings.offset_clear * offset
            kept = rows[clear]
            places.append(at[clear])
            values.append(np.full(len(kept), side * min(offset, prior.clip)))
            noise.append(wall.noise[kept] + np.hypot(settings.offset_sd, wall.tilt[kept]) * offset)
            weights.append(wall.weights[kept])
            amplitude.append(wall.amplitude[kept])
    return OffSurface(np.vstack(places), *map(np.concatenate, (values, noise, weights, amplitude)))


def field_through(
    wall: Oriented,
    off: OffSurface,
    prior: MovedPrior,
    lengths: list[float],
    settings: SplineSettings,
) -> SplineField:
    """Return the field g that phi = psi.T + g follows the points with: its mean given the points.

    lengths: widths of the lattices, from coarse to fine. Minimises the sum of the squared coefficients and of
    the squared residuals of values and gradients, by conjugate gradients.
    """
    places = np.vstack([wall.feet, off.at])
    count = len(wall.feet)
    lattices = [SplineLattice.around(places, length) for length in lengths]
    share = 1.0 / np.sqrt(len(lengths) * VARIANCE)
    rows = [lattice.rows(places) for lattice in lattices]
    scales = [share * _mean_around_splines(row, np.r_[wall.amplitude, off.amplitude]) for row in rows]
    wanted, precision = np.zeros((2, len(places), 4))
    wanted[:, 0] = np.r_[-wall.heights, off.values] - prior.at(places)
    wanted[:count, 1:] = wall.normals - prior.slope(wall.feet)
    # a tilted normal would lead to the foot of another place on the wall
    aside = wall.noise**2 + (wall.tilt * wall.heights) ** 2
    precision[:, 0] = np.r_[wall.weights / aside, off.weights / off.noise**2]
    precision[:count, 1:] = (wall.weights / (settings.normal_sd**2 + wall.tilt**2))[:, None]
    found = _solve_coefficients(rows, scales, wanted, precision, settings)
    return SplineField(lattices, [scale * part for scale, part in zip(scales, found, strict=True)])


def _mean_around_splines(rows: SplineRows, amplitude: Array) -> Array:
    """Return the mean (count,) around each spline of values known at places (n,)."""
    values = np.zeros((len(amplitude), 4))
    values[:, 0] = amplitude
    total = rows.back(values)
    values[:, 0] = 1.0
    return total / np.maximum(rows.back(values), TINY)


def _solve_coefficients(
    rows: list[SplineRows], scales: list[Array], wanted: Array, precision: Array, settings: SplineSettings
) -> list[Array]:
    """Solve for the coefficients z of each lattice that minimise |z|^2 + sum precision (value and gradient -
    wanted)^2.
    """
    ends = np.cumsum([row.count for row in rows])

    def back(values: Array) -> Array:
        return np.concatenate([scale * row.back(values) for row, scale in zip(rows, scales, strict=True)])

    def product(z: Array) -> Array:
        parts = np.split(z, ends[:-1])
        made = sum(row.of(scale * part) for row, scale, part in zip(rows, scales, parts, strict=True))
        return np.asarray(z + back(precision * made))

    squares = [scale**2 * row.squares(precision) for row, scale in zip(rows, scales, strict=True)]
    found, _ = cg(
        LinearOperator((ends[-1], ends[-1]), matvec=product, dtype=np.float64),
        back(precision * wanted),
        rtol=settings.tolerance,
        maxiter=settings.iterations,
        M=sparse.diags(1.0 / (1.0 + np.concatenate(squares))),
    )
    return np.split(found, ends[:-1])
