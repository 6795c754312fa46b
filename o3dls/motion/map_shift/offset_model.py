"""Offsets of a part of the points, in closed form.

Around a motion that was found the points are a linear Gaussian model, and an offset of a part of them is a
few more columns: what evidence these gain is known for every cut, in the order of the points or by a plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg.lapack import dtrtri

from ...arrays import Array, Ints
from ...noise.shifted_part import MapPart
from ...parallel import each
from ..field.gaussian_process import solve
from ..field.marginal_likelihood import MarginalLikelihood, Scales
from ..field.observations import Data, Rows
from ..iteration import State, find_feet, gather_rows
from ..problem import MotionProblem


class Offset(NamedTuple):
    """An offset (d,) shifts a part of the points; it has a covariance (d, d), and the nats that it gains."""

    part: MapPart
    offset: Array
    covariance: Array
    nats: float

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.offset))


@dataclass(frozen=True, eq=False)
class OffsetModel:
    """This is the linear Gaussian model of points around the surface that a fit has come to, each with a row
    of its own: their likelihood, noise (k,), inverses (k, k) of the residuals' covariance and of its Cholesky
    factor.
    """

    problem: MotionProblem
    scales: Scales
    likelihood: MarginalLikelihood
    noise: Array
    inverse: Array
    whitening: Array

    @property
    def rows(self) -> Rows:
        return self.likelihood.rows

    @property
    def directions(self) -> Array:
        return self.rows.observed.directions

    @cached_property
    def correction(self) -> float:
        """Laplace's correction to the free energy: most maps have no offset that asks for it."""
        return self.likelihood.laplace_of(self.scales, self.noise, self.inverse)


def offset_model(problem: MotionProblem, state: State) -> OffsetModel:
    """Return the model of a problem's points, no more than may have rows of their own, where a fit has come
    to.
    """
    rows = gather_rows(problem, find_feet(problem, state), state.without_history())
    likelihood = MarginalLikelihood.of(problem.covariance, rows)
    matrix, noise = likelihood.covariance(state.scales.log)
    posterior, inverse = solve(matrix, rows.residual)
    whitening, _ = dtrtri(posterior.factor, lower=1)
    return OffsetModel(problem, state.scales, likelihood, noise, inverse, whitening)


def best_offsets(model: OffsetModel, data: Data, taken_out: Offset | None = None) -> list[Offset]:
    """Return the offset that gains most in the order of the points and across each direction, best first.

    data: the points as they were measured, of which the model may have had an offset taken out.
    """
    residual = model.rows.residual
    if taken_out is not None:
        residual = residual + _offset_columns(data, taken_out.part, model.directions) @ taken_out.offset
    found = _find_offsets(model, data, model.whitening @ residual)
    return sorted(found, key=lambda one: one.nats, reverse=True)


def price(model: OffsetModel, data: Data, found: Offset) -> float:
    """Return the nats that an offset costs: all those that it could have been, and what its landmarks do."""
    variance = (model.problem.settings.map_shift.offset_sd * model.problem.size) ** 2
    columns = model.whitening @ _offset_columns(data, found.part, model.directions)
    known = _price_of_knowing(columns, variance)
    return float(known + 0.5 * found.offset @ found.offset / variance) + _odds_against(model, found.part)


def _price_of_knowing(columns: Array, variance: float) -> Array:
    """Return the nats that offsets N(0, variance) cost since they could have been others, by their whitened
    columns X (..., k, d): log det(1 + variance X' X) / 2.
    """
    information = columns.swapaxes(-1, -2) @ columns
    return np.asarray(0.5 * np.linalg.slogdet(np.eye(columns.shape[-1]) + variance * information)[1])


def _odds_against(model: OffsetModel, part: MapPart) -> float:
    """Return the nats against an offset that no landmarks speak for, before points are seen: landmarks are
    taken first, and stay.
    """
    stay = part.landmarks == "stay" and len(model.problem.marks) > 0
    return 0.0 if stay else model.problem.settings.map_shift.landmark_odds


def order_of(data: Data) -> Array:
    """Return when each point (n,) was taken: in the order of the file, if nothing else is known."""
    return np.arange(float(len(data.points))) if data.order is None else data.order


def cut_at(part: MapPart, key: Array, rows: Ints, cut: int) -> MapPart:
    """Return the part that begins with the point of a row in sorted order: just before it in time, or in the
    middle to its neighbour.
    """
    first = float(key[rows[cut]])
    before = first - 1.0 if part.direction is None else float(key[rows[cut - 1]])
    return replace(part, beyond=0.5 * (before + first))


def _find_offsets(model: OffsetModel, data: Data, residual: Array) -> list[Offset]:
    """Find the best cut in the order of the points and across each direction, for whitened residuals (k,)."""
    settings = model.problem.settings.map_shift
    count, dimension = data.points.shape
    columns = model.whitening.T[:, :, None] * model.directions[:, None]
    of_points = columns[:count]
    of_marks = columns[count:].reshape(-1, dimension, *columns.shape[1:]).sum(axis=1)

    def best(direction: Array | None) -> Offset:
        part = MapPart(direction, 0.0)
        key = part.key(data.points, order_of(data))
        rows = np.argsort(key, kind="stable")
        least = settings.least_part if direction is None else settings.least_side
        few = max(int(least * count), 1)
        cuts = np.arange(few, count - few + 1, max(count // settings.most_cuts, 1))
        beyond = _sums_beyond(of_points, rows, cuts)
        parts = [cut_at(part, key, rows, cut) for cut in cuts]
        choices = _with_landmarks(parts, len(data.marks_map) > 0)
        return max(
            (
                _pick_likeliest(model, some, beyond + _landmark_columns(some, data, of_marks), residual)
                for some in choices
            ),
            key=lambda one: one.nats,
        )

    return each(best, (None, *_cut_directions(dimension)))


def _sums_beyond(columns: Array, rows: Ints, cuts: Ints) -> Array:
    """Return the sums of the columns (n, k, d) of the points from each cut on in sorted order: (cuts,
    k, d).
    """
    segment = np.empty(len(rows), dtype=np.int64)
    segment[rows] = np.searchsorted(cuts, np.arange(len(rows)), side="right")
    # a sparse product adds up what lies between two cuts without a sorted copy of all columns
    between = sparse.csr_array(
        (np.ones(len(rows)), (segment, np.arange(len(rows)))), shape=(len(cuts) + 1, len(rows))
    )
    sums = np.asarray(between @ columns.reshape(len(rows), -1))[1:]
    return np.asarray(np.cumsum(sums[::-1], axis=0)[::-1].reshape(len(cuts), *columns.shape[1:]))


def _pick_likeliest(model: OffsetModel, parts: list[MapPart], columns: Array, residual: Array) -> Offset:
    """Pick the part whose offset gains most evidence, by the parts' whitened columns (parts, k, d) and
    residuals (k,).
    """
    dimension = columns.shape[2]
    variance = (model.problem.settings.map_shift.offset_sd * model.problem.size) ** 2
    # offset ~ N(0, variance) and residual = X offset + N(0, 1): precision X' X + 1 / variance
    covariances = np.linalg.inv(columns.transpose(0, 2, 1) @ columns + np.eye(dimension) / variance)
    pulls = residual @ columns
    offsets = (covariances @ pulls[:, :, None])[:, :, 0]
    prices = _price_of_knowing(columns, variance) + _odds_against(model, parts[0])
    nats = 0.5 * (pulls * offsets).sum(axis=1) - prices
    best = int(np.argmax(nats))
    return Offset(parts[best], offsets[best], covariances[best], float(nats[best]))


def _cut_directions(dimension: int) -> Iterator[Array]:
    """Yield the axes and diagonals of space, one of each two opposite ones."""
    signs = [np.array(one) for one in product((-1.0, 0.0, 1.0), repeat=dimension)]
    for sign in signs[len(signs) // 2 + 1 :]:
        yield sign / np.linalg.norm(sign)


def _with_landmarks(parts: list[MapPart], marks: bool) -> Iterator[list[MapPart]]:
    """Return the parts with all that landmarks may do: move along, or stay."""
    yield parts
    if marks:
        yield [replace(part, landmarks="move") for part in parts]
    if marks and parts[0].direction is not None:
        yield [replace(part, landmarks="part") for part in parts]


def _landmark_columns(parts: list[MapPart], data: Data, of_marks: Array) -> Array:
    """Return what the landmarks of each part add to its columns (parts, k, d)."""
    held = np.array([part.holds_marks(data.marks_map) for part in parts])
    return np.tensordot(held, of_marks, axes=1)


def _offset_columns(data: Data, part: MapPart, directions: Array) -> Array:
    """Return by how much the offset of a part changes the residuals of points and landmarks: (k, d)."""
    marks = np.repeat(part.holds_marks(data.marks_map), data.points.shape[1])
    member = np.r_[part.holds(data.points, order_of(data)), marks]
    return np.asarray(member[:, None] * directions)
