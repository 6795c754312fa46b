"""A motion fitted without an offset of a part of the points, and how much better both explain them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import ROUNDING, Array
from ...geometry.differential import unit_mean, vertex_normals
from ...noise.contact import contact_density
from ..field.observations import Data
from ..fit import settled
from ..iteration import State
from ..problem import MotionProblem
from ..result import Iterated
from .offset_model import Offset, OffsetModel, offset_model, order_of, price


@dataclass(frozen=True, eq=False)
class Trial:
    """A trial is a motion fitted without an offset, and the nats by which both explain the points better than
    a motion alone.
    """

    found: Offset
    run: Iterated
    model: OffsetModel
    evidence: float

    @property
    def problem(self) -> MotionProblem:
        return self.run.problem


def energy_alone(problem: MotionProblem) -> float:
    """Return the free energy (nats) of a motion alone, fitted from nothing, with Laplace's correction."""
    run = settled(problem)
    return run.energy + offset_model(problem, run.state).correction


def fitted_without(
    problem: MotionProblem, measured: Data, found: Offset, alone: Callable[[], float]
) -> Trial:
    """The trial of an offset. measured: the points with the offset in them; alone: tells the free energy of a
    motion alone, asked after the fit.
    """
    run = settled(replace(problem, data=_take_out(measured, found)))
    model = offset_model(run.problem, run.state)
    evidence = alone() - run.energy - model.correction - price(model, measured, found)
    return Trial(found, run, model, evidence)


def log_likelihood(problem: MotionProblem, state: State, points: Array) -> Array:
    """Return the log density (n,) of points (n, d) that are on the wall where a fit has come to, or
    outliers.
    """
    _, face, foot, bary = problem.tree.at(state.moved).query(points)
    normals = unit_mean(vertex_normals(state.moved, problem.faces), problem.faces[face], bary)
    outward = ((points - foot) * normals).sum(axis=1)
    noise = state.scales.errors(problem.data.group, problem.data.relative)
    fraction = state.contact.outlier_fraction
    density = (1.0 - fraction) * contact_density(outward, noise**2)
    return np.asarray(np.log(density + fraction * state.contact.outlier_density(outward) + ROUNDING))


def _take_out(data: Data, found: Offset) -> Data:
    """Return the points, and the landmarks that move along, without the offset of a part."""
    held = found.part.holds(data.points, order_of(data))[:, None]
    marks = found.part.holds_marks(data.marks_map)[:, None]
    return replace(
        data, points=data.points - held * found.offset, marks_map=data.marks_map - marks * found.offset
    )
