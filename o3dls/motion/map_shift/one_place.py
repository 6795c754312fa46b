"""Is it one place of the wall, and no part of the map, that an offset explains?

A slip moves all points that are taken after it, so each place that they reach speaks for it. A vein that the
prior lacks, or has too short, leaves points beyond its wall in one place, and an offset may lay these on wall
that is another's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from ...arrays import Ints
from ...parallel import both, once
from ..iteration import State
from ..problem import MotionProblem
from .offset_model import order_of
from .trial import Trial, energy_alone, fitted_without, log_likelihood


def is_shared(trial: Trial, problem: MotionProblem, state: State) -> bool:
    """Return whether enough of an offset's evidence is left without the place that speaks most for it, by
    motions fitted anew to the other points. problem, state: of a motion alone, and where that has come to.
    """
    settings = problem.settings.map_shift
    place = _place_that_gains_most(trial, problem, state)
    rest = problem.data.at(np.setdiff1d(np.arange(len(problem.data.points)), place))
    alone = once(lambda: energy_alone(replace(problem, data=rest)))
    left, _ = both(lambda: fitted_without(trial.problem, rest, trial.found, alone), alone)
    return left.evidence >= settings.shared * trial.evidence


def _place_that_gains_most(trial: Trial, problem: MotionProblem, state: State) -> Ints:
    """Return the rows of the points of the part within a ball, as large as a vein's or an appendage's, to
    which its offset brings most.
    """
    data, found = problem.data, trial.found
    held = found.part.holds(data.points, order_of(data))
    without = log_likelihood(trial.problem, trial.run.state, data.points - held[:, None] * found.offset)
    gain = (without - log_likelihood(problem, state, data.points)) * ~data.inside
    rows = np.flatnonzero(held)
    at = data.points[rows]
    balls = KDTree(at).query_ball_point(at, problem.settings.map_shift.place * problem.size)
    best = int(np.argmax([gain[rows[near]].sum() for near in balls]))
    return np.asarray(rows[balls[best]])
