"""Leverage points: points off the wall that have pulled the wall out to them.

Points of another chamber, or many that float together, can outweigh what a motion costs, since its prior has
no limit to how far a wall may stretch. So where points that were far off the wall at the start touch it, or a
part of the wall is stretched, a fit that begins without these points is compared with the one that has them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..geometry.differential import stretches
from ..geometry.surface import Surface
from .iteration import State
from .problem import MotionProblem
from .result import Iterated
from .settings import LeverageSettings


def captured_points(problem: MotionProblem, state: State) -> NDArray[np.bool_]:
    """Return the points (n,) that are off the wall at the start and on it after the motion."""
    return np.asarray((problem.first_weights < 0.5) & (state.weights > 0.5))


def stretched_faces(
    rest: Surface, moved: Array, settings: LeverageSettings
) -> tuple[NDArray[np.bool_], float]:
    """Find the faces (m,) that get much longer when the vertices move to `moved` (n, d), and the fraction of
    the area that they make up.
    """
    long = stretches(rest.vertices, moved, rest.faces) > settings.stretch
    return long, float(rest.face_areas[long].sum() / rest.area)


def leverage_points(run: Iterated) -> NDArray[np.bool_]:
    """Return the points (n,) that may have pulled the wall out: those that the motion captured, if they are
    some, and those on a part that is stretched, if that is large. None if they are most of the map.
    """
    problem, state = run.problem, run.state
    settings = problem.settings.leverage
    suspect = captured_points(problem, state)
    suspect &= suspect.sum() > settings.captured_points
    long, fraction = stretched_faces(Surface(problem.rest.at, problem.faces), state.moved, settings)
    if fraction > settings.stretched_area:
        face = problem.tree.at(state.moved).query(problem.data.points)[1]
        suspect |= long[face] & (state.weights > 0.5)
    return np.asarray(suspect & (suspect.mean() < settings.majority))


def energy_with_strain(run: Iterated) -> float:
    """Return the free energy of a run plus how unlikely its strains are, in nats: the logarithm of each
    patch's stretch is normally distributed around 0.
    """
    problem = run.problem
    rest = Surface(problem.rest.at, problem.faces)
    longer = np.log(np.maximum(stretches(rest.vertices, run.state.moved, rest.faces), 1.0))
    patches = rest.area / min(problem.covariance.lengths) ** (rest.dimension - 1)
    sd = problem.settings.leverage.strain_log_sd
    return run.energy + float(0.5 * patches * (rest.face_areas @ longer**2) / rest.area / sd**2)
