"""Fitting the motion T of the prior: a similarity, strains and a smooth field, to points, by evidence.

Rounds (`problem`) until the surface stands still; then what the points prefer (`choice`): a motion or none,
the prior as it is or smoothed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from threadpoolctl import ThreadpoolController

from ..arrays import Array, Ints
from ..geometry.differential import unit_mean, vertex_normals
from ..noise.contact import believe
from .model_selection import DECISIVE, shown, smoother
from .observations import Data
from .problem import LATE, Problem, Run
from .result import MotionFit, State
from .settings import Settings
from .stretch_hypothesis import doubtful, drawn

MENDINGS = 3  # of the start pose: points that mean no surface have it mended for ever
# factor on the odds of being off the wall, for points that may have drawn it: until the wall stands without
# them
ALOOF = 1e6
MANY_ROUNDS = 8  # with all points, after a fit to some of them
# on matrices of a few hundred rows, two threads take three times as long as one
LIBRARIES = ThreadpoolController()
# one more point moves the surface by a fraction of the noise: a second round would move it by hundredths of
# that
WARM_ROUNDS = 1


def fit_motion(
    vertices: Array,
    faces: Ints,
    pose: Array,
    data: Data,
    settings: Settings | None = None,
    warm: MotionFit | None = None,
) -> MotionFit:
    """Fit the motion of a surface (vertices (n, d), faces (m, d), prior frame) from a start pose (d+1, d+1)
    to `data` (map frame).

    `warm` starts from an earlier fit of the same surface to the first of the same points: its pose,
    amplitudes and noise levels are kept, and one round takes in the further points. Raises SolverError where
    no motion can be solved for.
    """
    with LIBRARIES.limit(limits=1, user_api="blas"):
        if warm is not None:
            return _proceed(warm, data, slice(len(warm.state.weights)), WARM_ROUNDS)
        return _from_nothing(vertices, faces, pose, data, settings or Settings())


def _from_nothing(vertices: Array, faces: Ints, pose: Array, data: Data, settings: Settings) -> MotionFit:
    """Of very many points, a part finds what all of them then proceed from; a start that others explain
    better is mended.
    """
    some = data.part(settings.many)
    if len(some) < len(data.points):
        first = _from_nothing(vertices, faces, pose, data.at(some), settings)
        fit = _proceed(first, data, some, MANY_ROUNDS)
        return replace(fit, trace=(*first.trace, *fit.trace))
    for _ in range(1 + MENDINGS):
        run = _without_drawn(_run(Problem.make(vertices, faces, pose, data, settings)))
        found = shown(run)
        if not found.mended:
            break
        pose = found.pose
    scales = found.scales
    # points that show no motion show no roughness either
    faired = smoother(run) if found.share == 1.0 else None
    if faired is not None:
        other = _without_drawn(_run(Problem.make(vertices, faces, pose, data, settings, faired)))
        if other.energy < run.energy:
            run = other
            scales = other.state.scales
    # what is not shown need not stand still
    run = replace(run, state=replace(run.state, scales=scales), moving=found.share * run.moving)
    return run.result(found.share, found.alone, settings.tolerance * run.problem.size)


def _proceed(earlier: MotionFit, data: Data, known: slice | Ints, rounds: int) -> MotionFit:
    """Rounds with all of `data`, of which the earlier fit had the `known` points: pose, amplitudes and noise
    levels are kept.
    """
    least = 0.1 * float(earlier.state.scales.noises[0])  # the surface stands within the noise
    problem = replace(earlier.problem, data=data)
    state = replace(earlier.state, weights=_first_beliefs(earlier, data, known), patches=None)
    trace = list[dict[str, float]]()
    for _ in range(rounds):
        state, solved, record = problem.step(state, LATE, tuning=False)
        trace.append(record)
        if record["step"] < least:
            break
    return Run(problem, state, solved, trace, trace[-1]["step"], earlier.facts).result(
        earlier.motion.share, earlier.motion.alone, least
    )


def _first_beliefs(earlier: MotionFit, data: Data, known: slice | Ints) -> Array:
    """Belief (n,) in the known points as it was, in the further ones by their distances from the surface as
    it is.
    """
    weights, state = data.trusted, earlier.state
    new = ~data.inside
    new[known] = False
    weights[known] = state.weights
    if new.any():
        surface = earlier.problem.tree.at(state.moved)
        _, face, foot, bary = surface.query(data.points[new])
        corners = earlier.problem.faces[face]
        outward = (data.points[new] - foot) * unit_mean(
            vertex_normals(state.moved, earlier.problem.faces), corners, bary
        )
        own = state.scales.noises[data.group[new]] * data.relative[new]
        weights[new], _ = believe(
            outward.sum(axis=1),
            own**2 + (bary * earlier.sd[corners]).sum(axis=1) ** 2,
            data.odds[new],
            state.contact,
        )
    return weights


def _without_drawn(run: Run) -> Run:
    """The run, or one that begins without the points that may have drawn the wall, and then hears them again,
    if it is clearly likelier.
    """
    problem = run.problem
    odd = drawn(run)
    if not odd.any():
        return run
    data = replace(problem.data, odds=np.where(odd, ALOOF, 1.0) * problem.data.odds)
    first = _run(replace(problem, data=data))
    other = _run(problem, replace(first.state, patches=None), LATE)
    behind = doubtful(other) - doubtful(run)
    count = float(odd.sum())
    if behind < -DECISIVE:
        return replace(other, trace=[*first.trace, *other.trace], facts={"let_go": count})
    apart = float(np.linalg.norm(other.state.moved - run.state.moved, axis=1).mean())
    return replace(run, facts={"rival_without": count, "rival_behind": behind, "rival_apart": apart})


def _run(problem: Problem, state: State | None = None, first: int = 0) -> Run:
    """Iterate until the vertices stand still: from nothing, or from a state and the number of its `first`
    round on.
    """
    settings = problem.settings
    state = state or problem.start()
    trace: list[dict[str, float]] = []
    for iteration in range(first, first + settings.iterations):
        at = state.feet_on
        state, solved, record = problem.step(state, iteration, tuning=iteration in settings.tune_at)
        trace.append(record)
        if iteration > max(settings.tune_at) and record["step"] < settings.tolerance * problem.size:
            break
    # vertices may slide along a surface that stands still
    along = ((state.moved - at) * vertex_normals(at, problem.faces)).sum(axis=1)
    return Run(problem, state, solved, trace, float(np.abs(along).mean()))
