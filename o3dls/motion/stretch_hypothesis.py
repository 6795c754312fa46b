"""Walls that points draw out which are not of them: of another chamber, or floating together.

The prior of the motion has no limit to how far a wall may stretch, and many such points outweigh what it
costs. So where points that were far off the wall at the start touch it, or a part of the wall is stretched, a
fit that begins without these points stands against it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..geometry.differential import stretches
from ..geometry.surface import Surface
from .problem import Problem, Run
from .result import State

WON = 5  # points off the wall at the start that may touch it after the motion, and nothing is asked
# a wall so much longer, on that share of its area, is drawn; 0.015 is the most among good fits
LONGER, TORN = (
    2.0,
    0.03,
)
STRAIN = (
    0.15  # sd of the logarithm of how much longer a wall gets, in patches of the shortest correlation length
)


def won(problem: Problem, state: State) -> NDArray[np.bool_]:
    """Points (n,) that are off the wall at the start and on it after the motion."""
    return np.asarray((problem.first_beliefs < 0.5) & (state.weights > 0.5))


def torn(rest: Surface, moved: Array) -> tuple[NDArray[np.bool_], float]:
    """Faces (m,) that get much longer when the vertices move to `moved` (n, d), and their share of the
    area.
    """
    long = stretches(rest.vertices, moved, rest.faces) > LONGER
    return long, float(rest.face_areas[long].sum() / rest.area)


def drawn(run: Run) -> NDArray[np.bool_]:
    """Points (n,) that may have drawn the wall: those that it won, if they are some, and those on a part that
    is stretched, if that is large.
    """
    problem, state = run.problem, run.state
    odd = won(problem, state)
    odd &= odd.sum() > WON
    long, share = torn(Surface(problem.rest.at, problem.faces), state.moved)
    if share > TORN:
        face = problem.tree.at(state.moved).query(problem.data.points)[1]
        odd |= long[face] & (state.weights > 0.5)
    return odd


def doubtful(run: Run) -> float:
    """Free energy of a run and how unlikely its strains are, in nats: the logarithm of each patch's stretch
    is N(0, STRAIN^2).
    """
    problem = run.problem
    rest = Surface(problem.rest.at, problem.faces)
    longer = np.log(np.maximum(stretches(rest.vertices, run.state.moved, rest.faces), 1.0))
    patches = rest.area / min(problem.covariance.lengths) ** (rest.dimension - 1)
    return run.energy + float(0.5 * patches * (rest.face_areas @ longer**2) / rest.area / STRAIN**2)
