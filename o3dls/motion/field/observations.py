"""From points to rows of the linear system: one each while they are few; by patches of the surface when they
are many.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Ints
from ...geometry.similarity import apply
from .covariance import Observed
from .drift import Taken


@dataclass(frozen=True)
class Data:
    """Data are what is fitted: points (n, d), which of the noise groups each is in, its noise relative to the
    group's, its own odds of floating, whether it is known to be inside only; landmarks.

    mapping: rows of the mapping points of the case, of which those at one place are one row;
    duplicate_distance: within what distance they are; groups: how many noise groups there are; typical_sigma:
    the `sigma` that relative noise is relative to, where points have one; order (n,): when each point was
    taken, if not as they come; moment (n,): a number that points share which a catheter took at once;
    isolation (n,): factors on the odds of floating by the other points.
    """

    PER_POINT: ClassVar = ("points", "group", "relative", "odds", "inside")

    points: Array
    group: Ints
    relative: Array
    odds: Array
    inside: NDArray[np.bool_]
    marks_prior: Array
    marks_map: Array
    groups: int = 1
    mapping: Ints | None = None
    typical_sigma: float | None = None
    duplicate_distance: float = 0.0
    order: Array | None = None
    moment: Ints | None = None
    isolation: Array | None = None

    def noise(self, levels: Array) -> Array:
        """Return the noise (n,) of each point, where the groups have these levels."""
        return np.asarray(levels[self.group] * self.relative)

    @property
    def outlier_odds(self) -> Array:
        """Factor (n,) on the odds of being an outlier."""
        return self.odds if self.isolation is None else self.odds * self.isolation

    @property
    def place_in_order(self) -> Array:
        """Place (n,) of each point in the order in which they were taken, where those of one moment stand
        together.
        """
        count = len(self.points)
        places = np.arange(float(count))
        if self.order is not None:
            places[np.argsort(self.order, kind="stable")] = np.arange(float(count))
        if self.moment is not None:
            moment = np.unique(self.moment, return_inverse=True)[1]
            middle = np.bincount(moment, places) / np.bincount(moment)
            places[np.lexsort((places, moment, middle[moment]))] = np.arange(float(count))
        return places

    @property
    def trusted(self) -> Array:
        """Belief (n,) in every point before any surface is known: those inside have nothing to say yet."""
        return np.where(self.inside, 0.0, 1.0)

    def part(self, most: int) -> Ints:
        """Return the rows of an even part of the points: at most so many of each group and of those inside:
        none crowds out others.
        """
        kind = 2 * self.group + self.inside
        rows = [np.flatnonzero(kind == one) for one in np.unique(kind)]
        return np.sort(np.concatenate([some[:: -(-len(some) // most)] for some in rows]))

    def at(self, which: slice | Ints) -> Data:
        """Return some of the points and all of the landmarks."""
        further = "order", "moment", "isolation"
        known = [name for name in (*self.PER_POINT, *further) if getattr(self, name) is not None]
        return replace(self, **{name: getattr(self, name)[which] for name in known})

    def differs(self, other: Data) -> NDArray[np.bool_]:
        """Return which points (n,) are not the same in other data of as many."""
        unlike = [getattr(self, name) != getattr(other, name) for name in self.PER_POINT]
        return np.asarray(np.column_stack(unlike).any(axis=1))


@dataclass(frozen=True)
class Feet:
    """Feet say where each point meets the wall: reference position (n, d), moved surface's normal (n, d), its
    share along the reference normal (n,), residual.
    """

    at: Array
    normals: Array
    along: Array
    residual: Array


@dataclass(frozen=True)
class Rows:
    """Rows make up the linear system: observations, residual (k,), noise group (k,), relative noise (k,),
    which row each point fell into (n,).

    scatter holds, per noise group, the squares by which points of one row differ, and how many more points
    are believed than there are rows: a row half believed tells half as much of the noise (the M step of the
    mixture); own_noise is the sum of the beliefs times the logarithms of the points' relative noise; drift
    has the covariances (k, k) of offsets that go together, of unit deviation, and taken says when rows were.
    """

    observed: Observed
    residual: Array
    group: Ints
    relative: Array
    of_point: Ints
    scatter: tuple[Array, Array]
    own_noise: float
    drift: tuple[Array, ...] = ()
    taken: Taken | None = None


LEAST_WEIGHT = (
    1e-6  # weight of a point that is not believed: keeps its row, and so its left-out residual, defined
)


def gather(feet: Feet, data: Data, weights: Array, marks: Array, of_point: Ints) -> Rows:
    """Return the rows of all points and landmarks: points that `of_point` (n,) gives one row speak with one
    voice.

    The precision-weighted mean is sufficient for a constant, and nearly so for a field that is smooth over a
    patch.
    """
    precision = np.maximum(weights, LEAST_WEIGHT) / data.relative**2
    count = int(of_point.max(initial=-1)) + 1
    total = np.bincount(of_point, precision, minlength=count)

    def mean(values: Array) -> Array:
        columns = values.reshape(len(values), -1).T
        return np.stack(
            [np.bincount(of_point, precision * c, minlength=count) / total for c in columns], axis=-1
        )

    group = np.zeros(count, dtype=np.int64)
    group[of_point] = data.group
    residual = mean(feet.residual)[:, 0]
    scatter = precision * (feet.residual - residual[of_point]) ** 2
    believed = np.bincount(data.group, weights, minlength=data.groups)
    squares = np.asarray(np.bincount(data.group, scatter, minlength=data.groups), dtype=np.float64)
    more = np.asarray(believed - np.bincount(group, minlength=data.groups), dtype=np.float64)
    observed = Observed(mean(feet.at), mean(feet.normals), mean(feet.along)[:, 0])
    own_noise = float(weights @ np.log(data.relative))
    rows = Rows(observed, residual, group, 1.0 / np.sqrt(total), of_point, (squares, more), own_noise)
    return _with_landmarks(rows, data, marks) if len(marks) else rows


def _with_landmarks(rows: Rows, data: Data, marks: Array) -> Rows:
    """Add one row per axis for each landmark, with a noise group of its own: picks are an order coarser than
    points.
    """
    dim = marks.shape[1]
    k = len(marks) * dim
    observed = Observed(
        np.vstack([rows.observed.at, np.repeat(marks, dim, axis=0)]),
        np.vstack([rows.observed.directions, np.tile(np.eye(dim), (len(marks), 1))]),
        np.r_[rows.observed.normal_part, np.zeros(k)],  # a landmark is in the vein's mouth, on no wall
    )
    residual = np.r_[rows.residual, (data.marks_map - marks).ravel()]
    scatter = np.r_[rows.scatter[0], 0.0], np.r_[rows.scatter[1], 0.0]
    group = np.r_[rows.group, np.full(k, data.groups)]
    return Rows(
        observed, residual, group, np.r_[rows.relative, np.ones(k)], rows.of_point, scatter, rows.own_noise
    )


def points_left_out(
    rows: Rows, feet: Feet, weights: Array, noise: Array, alone: tuple[Array, Array], own: Array
) -> tuple[Array, Array]:
    """Return the residual (n,) of each point to the fit without that point, and the variance (n,) to judge it
    by (fit plus noise); noise (k,) is that of the rows, as a variance, and own (n,) that of the points, as a
    deviation.

    A row's own left-out prediction N(m, v), of which `alone` holds residual (k,) and variance (k,), takes in
    again what the other points of its patch say, each as far as it is believed.
    """
    of = rows.of_point
    row_residual, row_variance = alone
    own = own**2
    said = 1.0 / noise[of]  # precision of the whole row, weights included
    mine = np.maximum(weights, LEAST_WEIGHT) / own
    others = np.where(np.bincount(of)[of] > 1, np.maximum(said - mine, 0.0), 0.0)
    without_row = rows.residual[of] - row_residual[of]
    var = 1.0 / (1.0 / row_variance[of] + others)
    mean = (
        var * (without_row / row_variance[of] + said * rows.residual[of] - mine * feet.residual)
        if others.any()
        else without_row
    )
    return feet.residual - mean, var + own


def number_patches(feet: Feet, group: Ints, patch: float, frame: Array) -> Ints:
    """Return the number (n,) of the patch of each foot: one cell of the reference, one group (n,), normals in
    one orthant.
    """
    cells = np.floor(apply(frame, feet.at) / patch).astype(np.int64)
    facing = (feet.normals @ frame[:-1, :-1].T > 0) @ (1 << np.arange(feet.normals.shape[1]))
    number = np.zeros(len(cells), dtype=np.int64)
    for column in (*cells.T, facing + (group << feet.normals.shape[1])):
        wide = number * (np.ptp(column) + 1) + column - column.min()
        number = np.unique(wide, return_inverse=True)[1].ravel()
    return np.asarray(number)
