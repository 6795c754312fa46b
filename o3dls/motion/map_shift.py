"""Is one part of the map shifted? Two maps in one, whose frames differ by an offset.

At the motion that was found the points are a linear Gaussian model, and an offset of a part of them is a few
more columns: the evidence that these gain is a closed form for every cut, in the order of the points or by a
plane. Where a cut gains, a motion is fitted without the offset, and judged by its free energy. Reasons and
numbers: docs/method.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from ..arrays import ROUNDING, Array
from ..geometry.differential import unit_mean, vertex_normals
from ..geometry.similarity import apply, fit_similarity
from ..noise.contact import contact_density
from ..noise.shifted_part import Landmarks, MapPart, MapShift
from ..parallel import one_blas_thread
from .covariance import grams
from .fit import settled
from .iteration import State, find_feet, gather_rows
from .marginal_likelihood import assemble, laplace_correction, solve
from .observations import Data
from .problem import MotionProblem, motion_problem
from .result import Iterated, MotionFit
from .settings import MapShiftSettings


class Offset(NamedTuple):
    """An offset (d,) of a part of the points, its covariance (d, d), and the nats that it gains."""

    part: MapPart
    offset: Array
    covariance: Array
    nats: float


@dataclass(frozen=True, eq=False)
class Model:
    """The linear Gaussian model of points around the surface that a fit has come to: directions (k, d) of its
    rows, their residuals (k,) and the inverse (k, k) of the Cholesky factor of their covariance.
    """

    problem: MotionProblem
    state: State
    directions: Array
    residual: Array
    whitening: Array
    correction: float


def find_map_shift(fit: MotionFit) -> tuple[MapShift, Array] | None:
    """The part of the map that one offset explains better than any motion does, and the pose (d+1, d+1) that
    the prior comes to without the offset; None where there is no such part.
    """
    with one_blas_thread():
        found = _search(fit)
    if found is None:
        return None
    offset, evidence, pose = found
    data = fit.problem.data
    mapping = (data.group == 0) & ~data.inside if data.mapping is None else data.mapping
    held = offset.part.holds(data.points, _order(data))[mapping]
    sd = fit.problem.settings.inflation * np.sqrt(np.diag(offset.covariance))
    shift = MapShift(offset.part, offset.offset, sd, evidence, int(held.sum()), len(held))
    if not _seen_from_the_wrong_side(shift, len(data.marks_map) > 0):
        return shift, pose
    pose = pose.copy()
    pose[:-1, -1] += shift.offset
    return shift.other_side(), pose


def _search(fit: MotionFit) -> tuple[Offset, float, Array] | None:
    """The offset, the nats by which it explains the points of the fit better, and the prior's pose without
    it: if they are enough.
    """
    settings = fit.problem.settings.map_shift
    problem, state, energy = _asked(fit)
    here = _model(problem, state)
    measured = problem.data
    first = _best(here, measured, None)
    if first.nats < settings.first_evidence or _length(first) < settings.first_offset * problem.size:
        return None
    if energy is None:
        run = settled(problem)
        here, energy = _model(problem, run.state), run.energy
    best, evidence, least = first, 0.0, settings.least_offset * problem.size
    for k in range(settings.rounds):
        run = settled(replace(problem, data=_taken_out(measured, best)))
        problem = _posed(run)
        there = _model(run.problem, run.state)
        evidence = energy + here.correction - run.energy - there.correction - _price(there, measured, best)
        if k > 0 and (evidence < settings.first_evidence or _length(best) < least):
            return None
        again = _sharpened(there, measured, _best(there, measured, best))
        still = settings.settled * float(run.state.scales.noises[0])
        if np.linalg.norm(again.offset - best.offset) < still:
            break
        best = again
    plane = best.part.direction is not None
    enough = settings.evidence_side if plane else settings.evidence_order
    return (best, evidence, problem.pose) if evidence >= enough and _length(best) >= least else None


def _posed(run: Iterated) -> MotionProblem:
    """The problem of a run in the pose that it came to: the one before was found with the offset."""
    problem = run.problem
    moved = fit_similarity(problem.rest.at, run.state.moved)
    length = problem.smoothing_length
    smoothed = (length, apply(moved, problem.rest.at)) if length else None
    return motion_problem(
        problem.vertices, problem.faces, moved @ problem.pose, problem.data, problem.settings, smoothed
    )


def _asked(fit: MotionFit) -> tuple[MotionProblem, State, float | None]:
    """Problem and state of the points that are asked, an even part of many; their free energy if known."""
    problem, state = fit.problem, fit.state
    data = replace(problem.data, order=_order(problem.data))
    some = data.part(problem.settings.map_shift.most_points)
    every = len(some) == len(data.points)
    state = replace(state, weights=state.weights[some], patches=None)
    return replace(problem, data=data.at(some)), state, fit.energy if every else None


def _model(problem: MotionProblem, state: State) -> Model:
    rows = gather_rows(problem, find_feet(problem, state), replace(state, patches=None))
    fixed, parts = grams(problem.covariance, rows.observed)
    matrix, _ = assemble(state.scales.log, fixed, parts, rows)
    factor = solve(matrix, rows.residual)[0].factor
    whitening = solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False)
    correction = laplace_correction(state.scales, fixed, parts, rows)
    return Model(problem, state, rows.observed.directions, rows.residual, whitening, correction)


def _best(model: Model, data: Data, taken_out: Offset | None) -> Offset:
    """The offset of the points as they were measured that gains most, where one may have been taken out."""
    residual = model.residual
    if taken_out is not None:
        residual = residual + _columns(data, taken_out.part, model.directions) @ taken_out.offset
    parts = list(_parts(data, model.problem.settings.map_shift))
    columns = np.stack([_columns(data, part, model.directions) for part in parts], axis=1)
    whitened = (model.whitening @ columns.reshape(len(residual), -1)).reshape(columns.shape)
    return max(_offsets(model, parts, whitened, model.whitening @ residual), key=lambda one: one.nats)


def _offsets(model: Model, parts: list[MapPart], columns: Array, residual: Array) -> Iterator[Offset]:
    """What each part's offset gains, by its whitened columns (k, parts, d) and residuals (k,)."""
    settings = model.problem.settings.map_shift
    precision = (settings.offset_sd * model.problem.size) ** -2 * np.eye(columns.shape[2])
    seen = np.einsum("kpi,kpj->pij", columns, columns)
    pulls = np.einsum("kpi,k->pi", columns, residual)
    for part, information, pull in zip(parts, seen, pulls, strict=True):
        covariance = np.linalg.inv(information + precision)
        offset = covariance @ pull
        price = 0.5 * np.linalg.slogdet(np.eye(len(pull)) + information / precision[0, 0])[1]
        yield Offset(part, offset, covariance, float(0.5 * pull @ offset - price))


def _price(model: Model, data: Data, found: Offset) -> float:
    """Nats that an offset costs: all those that it could have been."""
    variance = (model.problem.settings.map_shift.offset_sd * model.problem.size) ** 2
    columns = model.whitening @ _columns(data, found.part, model.directions)
    known = np.linalg.slogdet(np.eye(columns.shape[1]) + variance * columns.T @ columns)[1]
    return 0.5 * float(known + found.offset @ found.offset / variance)


def _parts(data: Data, settings: MapShiftSettings) -> Iterator[MapPart]:
    """Cuts in the order of the points, and planes across axes and diagonals, with what landmarks may do."""
    order, marks = _order(data), len(data.marks_map) > 0
    for share in np.linspace(settings.least_part, 1.0 - settings.least_part, settings.order_cuts):
        yield from _with_landmarks(None, float(np.quantile(order, share)), marks)
    signs = [np.array(one) for one in product((-1.0, 0.0, 1.0), repeat=data.points.shape[1])]
    for sign in signs[len(signs) // 2 + 1 :]:  # of each two opposite ones one
        direction = sign / np.linalg.norm(sign)
        along = data.points @ direction
        for share in np.linspace(settings.least_side, 1.0 - settings.least_side, settings.plane_cuts):
            yield from _with_landmarks(direction, float(np.quantile(along, share)), marks)


def _with_landmarks(direction: Array | None, beyond: float, marks: bool) -> Iterator[MapPart]:
    choices: tuple[Landmarks, ...] = ("stay",)
    if marks:
        choices = ("stay", "move") if direction is None else ("stay", "move", "part")
    for landmarks in choices:
        yield MapPart(direction, beyond, landmarks)


def _columns(data: Data, part: MapPart, directions: Array) -> Array:
    """What an offset of a part changes of the residuals: (k, d), of points and landmarks."""
    marks = np.repeat(part.holds_marks(data.marks_map), data.points.shape[1])
    member = np.r_[part.holds(data.points, _order(data)), marks]
    return np.asarray(member[:, None] * directions)


def _sharpened(model: Model, data: Data, found: Offset) -> Offset:
    """The same offset with the cut where the points, as they were measured, are likeliest to have it or not
    by their distances from the surface.
    """
    settings = model.problem.settings.map_shift
    key = found.part.key(data.points, _order(data))
    gain = _log_likelihood(model, data.points - found.offset) - _log_likelihood(model, data.points)
    rows = np.argsort(key, kind="stable")
    beyond = np.cumsum((gain * ~data.inside)[rows][::-1])[::-1]
    few = max(int(settings.least_part * len(rows)), 1)
    cut = few + int(np.argmax(beyond[few : len(rows) - few]))
    between = 0.5 * float(key[rows[cut - 1]] + key[rows[cut]])
    return found._replace(part=replace(found.part, beyond=between))


def _log_likelihood(model: Model, points: Array) -> Array:
    """Of points (n, d): on the wall, or outliers."""
    problem, state = model.problem, model.state
    _, face, foot, bary = problem.tree.at(state.moved).query(points)
    normals = unit_mean(vertex_normals(state.moved, problem.faces), problem.faces[face], bary)
    outward = ((points - foot) * normals).sum(axis=1)
    noise = state.scales.noises[problem.data.group] * problem.data.relative
    fraction = state.contact.outlier_fraction
    density = (1.0 - fraction) * contact_density(outward, noise**2)
    return np.asarray(np.log(density + fraction * state.contact.outlier_density(outward) + ROUNDING))


def _taken_out(data: Data, found: Offset) -> Data:
    """The points, and the landmarks that move along, without the offset of a part."""
    held = found.part.holds(data.points, _order(data))[:, None]
    marks = found.part.holds_marks(data.marks_map)[:, None]
    return replace(
        data, points=data.points - held * found.offset, marks_map=data.marks_map - marks * found.offset
    )


def _order(data: Data) -> Array:
    return np.arange(float(len(data.points))) if data.order is None else data.order


def _length(found: Offset) -> float:
    return float(np.linalg.norm(found.offset))


def _seen_from_the_wrong_side(shift: MapShift, marks: bool) -> bool:
    """Whether it is the other side of a plane that is shifted: the one that has not the landmarks or, where
    these are on both, the smaller one.
    """
    part = shift.part
    if part.direction is None or (marks and part.landmarks == "stay"):
        return False
    return part.landmarks == "move" or 2 * shift.points > shift.total
