"""The linear least-squares problem of the field: values, normals, and signs off the wall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg
from scipy.spatial import KDTree

from ...arrays import TINY, Array
from .moved_prior import MovedPrior
from .settings import SplineSettings
from .splines import VARIANCE, SplineField, SplineLattice


@dataclass(frozen=True, eq=False)
class Oriented:
    """Points of a wall as heights (n,) along outward normals (n, 3) over their feet (n, 3), places near the
    wall; the noise (n,) of each, and the probability (n,) that it touches.

    Noise moves a point along the normal too: a field that is read where the points are follows it.
    """

    feet: Array
    heights: Array
    normals: Array
    noise: Array
    weights: Array

    def of(self, rows: NDArray[np.bool_]) -> Oriented:
        """Those of a mask (n,)."""
        return Oriented(
            self.feet[rows], self.heights[rows], self.normals[rows], self.noise[rows], self.weights[rows]
        )

    def nearer(self, distance: Array) -> Oriented:
        """The same points with feet moved by signed distances (n,) to a wall."""
        return replace(
            self, feet=self.feet - distance[:, None] * self.normals, heights=self.heights + distance
        )


@dataclass(frozen=True, eq=False)
class OffSurface:
    """Places (k, 3) off the wall where phi is known: values (k,), their noise (k,) and weights (k,)."""

    at: Array
    values: Array
    noise: Array
    weights: Array


def off_prior(wall: Oriented, prior: MovedPrior, settings: SplineSettings) -> NDArray[np.bool_]:
    """Which points (n,) lie off the moved prior's wall, or on one that looks elsewhere, and most of those
    around them too: one alone is rather no point of the wall.
    """
    turned = (prior.slope(wall.feet) * wall.normals).sum(axis=1) < settings.offset_cosine
    off = (np.abs(wall.heights + prior.at(wall.feet)) > settings.offset_noise * wall.noise) | turned
    around = KDTree(wall.feet).query(wall.feet, k=min(settings.offset_neighbours, len(off)))[1]
    return np.asarray(off & (off[around].mean(axis=1) > 0.5))


def off_surface(
    wall: Oriented, off: NDArray[np.bool_], prior: MovedPrior, radius: float, settings: SplineSettings
) -> OffSurface:
    """Where points are `off` (n,) the moved prior, phi on both sides of them: what was wall there is none,
    and what was not inside is (Carr et al. 2001). Places that other points are nearer to are left out.
    """
    rows = np.flatnonzero(off)
    near = KDTree(wall.feet)
    places, values, noise, weights = [], [], [], []
    for offset in radius * np.asarray(settings.offsets):
        for side in (1.0, -1.0):
            at = wall.feet[rows] + side * offset * wall.normals[rows]
            clear = near.query(at)[0] > settings.offset_clear * offset
            kept = rows[clear]
            places.append(at[clear])
            values.append(np.full(len(kept), side * min(offset, prior.clip)))
            noise.append(wall.noise[kept] + settings.offset_sd * offset)
            weights.append(wall.weights[kept])
    return OffSurface(np.vstack(places), *map(np.concatenate, (values, noise, weights)))


def field_through(
    wall: Oriented,
    off: OffSurface,
    prior: MovedPrior,
    amplitude: Array,
    lengths: list[float],
    settings: SplineSettings,
) -> SplineField:
    """The field g that phi = psi.T + g follows the points with: its mean given the points.

    amplitude (n + k,): deviation of g before, at the points and the places beside them; lengths: widths of
    the lattices, from coarse to fine. Minimises the sum of the squared coefficients and of the squared
    residuals of values and gradients, by conjugate gradients.
    """
    places = np.vstack([wall.feet, off.at])
    lattices = [SplineLattice.around(places, length) for length in lengths]
    share = settings.falling ** -np.arange(len(lengths), dtype=float)
    share /= np.sqrt((share**2).sum() * VARIANCE)
    values, scales = list[sparse.csr_matrix](), list[Array]()
    slopes: list[list[sparse.csr_matrix]] = [[], [], []]
    for lattice, part in zip(lattices, share, strict=True):
        value, slope = lattice.rows(places)
        around = value.T @ amplitude / np.maximum(value.T @ np.ones(len(places)), TINY)
        scale = sparse.diags(part * around)
        scales.append(part * around)
        values.append(value @ scale)
        for along, one in zip(slopes, slope, strict=True):
            along.append(one[: len(wall.feet)] @ scale)
    matrix = sparse.vstack([sparse.hstack(one) for one in (values, *slopes)]).tocsr()
    gradient = wall.normals - prior.slope(wall.feet)
    wanted = np.concatenate([-wall.heights - prior.at(wall.feet), off.values - prior.at(off.at), *gradient.T])
    precision = np.concatenate(
        [
            wall.weights / wall.noise**2,
            off.weights / off.noise**2,
            *[wall.weights / settings.normal_sd**2] * 3,
        ]
    )
    found = _solved(matrix, wanted, precision, settings)
    parts = np.split(found, np.cumsum([lattice.count for lattice in lattices])[:-1])
    return SplineField(lattices, [scale * part for scale, part in zip(scales, parts, strict=True)])


def _solved(matrix: sparse.csr_matrix, wanted: Array, precision: Array, settings: SplineSettings) -> Array:
    """Minimum of |z|^2 + sum precision (matrix z - wanted)^2."""
    scaled = sparse.csr_matrix(sparse.diags(np.sqrt(precision)) @ matrix)
    back = scaled.T.tocsr()
    diagonal = 1.0 + np.asarray(back.multiply(back).sum(axis=1)).ravel()
    size = matrix.shape[1]
    normal = LinearOperator((size, size), matvec=lambda z: z + back @ (scaled @ z), dtype=np.float64)
    found, _ = cg(
        normal,
        back @ (np.sqrt(precision) * wanted),
        rtol=settings.tolerance,
        maxiter=settings.iterations,
        M=sparse.diags(1.0 / diagonal),
    )
    return np.asarray(found)
