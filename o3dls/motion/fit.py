"""Fitting the motion T of the prior, a similarity, strains and a smooth field, to points, by evidence.

Rounds (`iteration`) until the surface stands still; a comparison with a fit that begins without points that
may have pulled the wall out (`leverage_points`); then what the points prefer (`model_selection`): a motion or
none, the prior as it is or smoothed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Ints, Mask
from ..geometry.differential import unit_mean, vertex_normals
from ..noise.crowds import possible_crowds
from ..parallel import both, each, one_blas_thread
from .field.observations import Data
from .iteration import Solved, State, begin, step
from .leverage_points import energy_with_strain, leverage_points
from .model_selection import Preference, preferred
from .problem import MotionProblem, motion_problem
from .result import Iterated, MotionFit, motion_fit
from .settings import MotionSettings


def fit_motion(
    vertices: Array,
    faces: Ints,
    pose: Array,
    data: Data,
    settings: MotionSettings | None = None,
    warm: MotionFit | None = None,
) -> MotionFit:
    """Fit the motion of a surface (vertices (n, d), faces (m, d), prior frame) from a start pose (d+1, d+1)
    to `data` (map frame).

    `warm` starts from an earlier fit of the same surface to the first of the same points: its pose,
    amplitudes and noise levels are kept, and one round takes in the further points. Raises SolverError where
    no motion can be solved for.
    """
    with one_blas_thread():
        if warm is not None:
            rounds = warm.problem.settings.iteration.rounds_of_update
            return _continue_fit(warm, data, slice(len(warm.state.weights)), rounds)
        return _fit_from_nothing(vertices, faces, pose, data, settings or MotionSettings())


def settled(problem: MotionProblem) -> Iterated:
    """Run the rounds of a problem from nothing until the surface stands still. Raises SolverError as
    `fit_motion`.
    """
    with one_blas_thread():
        return _iterate_rounds(problem, begin(problem))


def _fit_from_nothing(
    vertices: Array, faces: Ints, pose: Array, data: Data, settings: MotionSettings
) -> MotionFit:
    """Fit from nothing: a subset of a large map first, then all of it from there. A start that another pose
    explains better is corrected.
    """
    some = data.part(settings.iteration.most_points)
    if len(some) < len(data.points):
        first = _fit_from_nothing(vertices, faces, pose, data.at(some), settings)
        data = data.with_crowd_of(first.problem.data)
        fit = _continue_fit(first, data, some, settings.iteration.rounds_with_all)
        return replace(fit, trace=(*first.trace, *fit.trace))
    for _ in range(1 + settings.selection.pose_corrections):
        problem = motion_problem(vertices, faces, pose, data, settings)
        run, (found, smoothed) = _run_and_preference(problem)
        if not found.corrected:
            break
        pose = found.pose
    scales = found.scales
    if smoothed is not None:
        problem = motion_problem(vertices, faces, pose, data, settings, smoothed)
        other = _likeliest_run(problem)
        if other.energy < run.energy:
            run = other
            scales = other.state.scales
    # the part of the motion that is not followed may still move
    state = replace(run.state, scales=scales)
    run = replace(run, state=state, moving=found.probability * run.moving)
    least = settings.iteration.tolerance * run.problem.size
    return motion_fit(run, found.probability, found.pose_alone, least)


def _continue_fit(earlier: MotionFit, data: Data, known: slice | Ints, rounds: int) -> MotionFit:
    """Run rounds with all of `data`, of which the earlier fit had the `known` points, and keep its pose,
    amplitudes and noise levels.
    """
    problem = replace(earlier.problem, data=data)
    least = problem.settings.iteration.update_tolerance * float(earlier.state.scales.noises[0])
    state = replace(earlier.state.without_history(), weights=_first_weights(earlier, data, known))
    trace = list[dict[str, float]]()
    for _ in range(rounds):
        state, solved, record = step(problem, state, None)
        trace.append(record)
        if record["step"] < least:
            break
    run = Iterated(problem, state, solved, tuple(trace), trace[-1]["step"], earlier.facts)
    return motion_fit(run, earlier.motion.probability, earlier.motion.pose_alone, least)


def _first_weights(earlier: MotionFit, data: Data, known: slice | Ints) -> Array:
    """Return the probability of contact (n,) of the known points as it was, of the further ones by their
    distances from the surface as it is.
    """
    weights, state = data.trusted, earlier.state
    new = ~data.inside
    new[known] = False
    weights[known] = state.weights
    if new.any():
        outward, corners, bary = _look_from(data.points[new], earlier.problem, state)
        own = state.scales.errors(data.group[new], data.relative[new])
        variance = own**2 + (bary * earlier.sd[corners]).sum(axis=1) ** 2
        weights[new], _ = earlier.problem.contacts(outward, variance, data.outlier_odds[new], state.contact)
    return weights


def _look_from(points: Array, problem: MotionProblem, state: State) -> tuple[Array, Ints, Array]:
    """Return how far (n,) points lie outside the wall as it is, and the corners (n, d) and weights (n, d) of
    their feet on it.
    """
    _, face, foot, bary = problem.tree.at(state.moved).query(points)
    corners = problem.faces[face]
    normals = unit_mean(vertex_normals(state.moved, problem.faces), corners, bary)
    return ((points - foot) * normals).sum(axis=1), corners, bary


def _run_and_preference(problem: MotionProblem) -> tuple[Iterated, Preference]:
    """Return the likeliest run and what the points prefer to it. Mostly the first run stays: that is asked
    of it while the other one is under way.
    """
    run = _run_past_crowds(problem)
    suspect = leverage_points(run)
    if not suspect.any():
        return run, preferred(run)
    preference, other = both(partial(preferred, run), partial(_without_at_first, run.problem, suspect))
    likelier = _likelier_run(run, other, suspect)
    return likelier, preferred(likelier) if likelier.state is other.state else preference


def _likeliest_run(problem: MotionProblem) -> Iterated:
    """Iterate; where points may have pulled the wall out, begin without them, take them in again, and return
    that run if it is clearly likelier.
    """
    run = _run_past_crowds(problem)
    suspect = leverage_points(run)
    return _likelier_run(run, _without_at_first(run.problem, suspect), suspect) if suspect.any() else run


def _likelier_run(run: Iterated, other: Iterated, suspect: Mask) -> Iterated:
    """Return the other run, begun without the suspect points (n,), if it is clearly likelier; with facts on
    both.
    """
    behind = energy_with_strain(other) - energy_with_strain(run)
    count = float(suspect.sum())
    if behind < -run.problem.settings.selection.decisive:
        return replace(other, facts={**run.facts, "excluded_points": count})
    apart = float(np.linalg.norm(other.state.moved - run.state.moved, axis=1).mean())
    facts = {"alternative_excluded": count, "alternative_behind": behind, "alternative_apart": apart}
    return replace(run, facts={**run.facts, **facts})


def _run_past_crowds(problem: MotionProblem) -> Iterated:
    """Iterate; where many points of a place float inside, iterate again with the wall elsewhere and most of
    them expected to float, and return that run if it is clearly likelier and its wall is another one there:
    that outliers lie together is no reason to change anything else.
    """
    run, wall = _iterate_rounds(problem, begin(problem)), ~problem.data.inside
    if problem.data.crowd is not None:  # it is known already where there is one
        return run
    points = problem.data.points[wall]
    afloat = (1.0 - run.state.weights[wall]) * (_look_from(points, problem, run.state)[0] < 0.0)
    crowds = possible_crowds(points, afloat, problem.settings.crowds)
    others = each(partial(_run_beside, problem, wall), crowds)
    best = min(others, key=energy_with_strain, default=run)
    ahead = energy_with_strain(run) - energy_with_strain(best)
    if ahead < problem.settings.selection.decisive:
        return run
    least = problem.settings.crowds.apart * float(run.state.scales.noises[0])
    return best if _apart_at_crowd(run, best) > least else run


def _apart_at_crowd(run: Iterated, other: Iterated) -> float:
    """Return how far the walls of two runs are apart in the mean at the crowd of the other one."""
    data, tree = other.problem.data, other.problem.tree
    assert data.crowd is not None
    feet = tree.at(other.state.moved).query(data.points[data.crowd > 1.0])[2]
    return float(np.sqrt(tree.at(run.state.moved).query(feet)[0]).mean())


def _run_beside(problem: MotionProblem, wall: Mask, crowd: Mask) -> Iterated:
    """Return the run that begins without a crowd of the points at the wall, and then expects of each of its
    points that it floats.
    """
    known, factors = problem.settings.crowds, np.ones(len(wall))
    factors[wall] = np.where(crowd, problem.settings.leverage.exclusion_odds, 1.0)
    without = replace(problem, data=replace(problem.data, crowd=factors))
    first = _iterate_rounds(without, begin(without))
    usual = first.state.contact.outlier_fraction
    odds = known.floating / (1.0 - known.floating) * (1.0 - usual) / usual
    factors = np.where(factors > 1.0, odds, 1.0)
    beside = replace(problem, data=replace(problem.data, crowd=factors))
    run = _iterate_rounds(beside, first.state.without_history(), anneal=False)
    return replace(run, trace=(*first.trace, *run.trace), facts={"crowd_points": float(crowd.sum())})


def _without_at_first(problem: MotionProblem, suspect: Mask) -> Iterated:
    """Return the run that goes on, with all points, from one without the suspect ones."""
    odds = np.where(suspect, problem.settings.leverage.exclusion_odds, 1.0) * problem.data.odds
    without = replace(problem, data=replace(problem.data, odds=odds))
    first = _iterate_rounds(without, begin(without))
    run = _iterate_rounds(problem, first.state.without_history(), anneal=False)
    return replace(run, trace=(*first.trace, *run.trace))


class Round(NamedTuple):
    """A round says where the iteration of a fit has come to."""

    state: State
    solved: Solved
    record: dict[str, float]


def _iterate_rounds(problem: MotionProblem, state: State, *, anneal: bool = True) -> Iterated:
    """Run rounds until the surface stands still: from nothing, or without annealing from an earlier state."""
    trace: list[dict[str, float]] = []
    for last in run_rounds(problem, state, anneal=anneal):
        trace.append(last.record)
    return Iterated(problem, last.state, last.solved, tuple(trace), trace[-1]["step"])


def run_rounds(
    problem: MotionProblem, state: State, *, anneal: bool = True, enough: float = 0.0
) -> Iterator[Round]:
    """Yield rounds until the surface stands still, or the energy changes by less than `enough` (nats)."""
    settings = problem.settings.iteration
    energy = np.inf
    for k in range(settings.iterations):
        before, iteration = energy, k if anneal else None
        state, solved, record = step(problem, state, iteration, tuning=anneal and k in settings.tune_at)
        yield Round(state, solved, record)
        energy = record["energy"]
        # the weights found in one round move the surface only in the next
        tuned = k > (max(settings.tune_at) if anneal else 0)
        still = record["step"] < settings.tolerance * problem.size or abs(energy - before) < enough
        if tuned and still:
            return
