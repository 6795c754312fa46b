"""Fitting the motion T of the prior, a similarity, strains and a smooth field, to points, by evidence.

Rounds (`iteration`) until the surface stands still; a comparison with a fit that begins without points that
may have pulled the wall out (`leverage_points`); then what the points prefer (`model_selection`): a motion or
none, the prior as it is or smoothed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import chain, count
from threading import Lock
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Ints, Mask
from ..geometry.differential import unit_mean, vertex_normals
from ..parallel import both, once, one_blas_thread
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
            # one round: a further point moves the surface by a fraction of the noise
            return _continue_fit(warm, data, slice(len(warm.state.weights)), 1)
        return _fit_from_nothing(vertices, faces, pose, data, settings or MotionSettings())


class TrialFit:
    """A trial fit compares the energies of one surface and another: its rounds are run as they are asked for,
    until the surface stands still or the energy does, without what `fit_motion` weighs after them. Parameters
    and errors as there.
    """

    def __init__(
        self, vertices: Array, faces: Ints, pose: Array, data: Data, settings: MotionSettings
    ) -> None:
        self._problem = once(lambda: motion_problem(vertices, faces, pose, data, settings))
        self._rounds = self._start_rounds(settings.selection.steady_energy)
        self._tuned = min(settings.iteration.tune_at)
        self._energies: list[float] = []
        self._lock = Lock()

    def _start_rounds(self, steady: float) -> Iterator[Round]:
        problem = self._problem()
        yield from _run_rounds(problem, begin(problem), enough=steady)

    def energy(self, k: int) -> float:
        """Return the free energy (nats) of round k, or of the last one, if that was earlier; several threads
        may ask.
        """
        with self._lock, one_blas_thread():
            while len(self._energies) <= k and (reached := next(self._rounds, None)) is not None:
                self._energies.append(reached.record["energy"])
        return self._energies[min(k, len(self._energies) - 1)]

    def lead(self, other: TrialFit, least: float, early: tuple[int, ...]) -> float:
        """Return by how much (nats) this fit's last energy is below the other's; or that of a round, the
        first of some `early` ones and of those after tuning in which it is less than `least`.
        """
        for k in chain(early, count(self._tuned + 1)):
            own, others = both(partial(self.energy, k), partial(other.energy, k))
            found = others - own
            if found < least or k >= max(len(self._energies), len(other._energies)):
                break
        return found


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
    faces = earlier.problem.faces
    new = ~data.inside
    new[known] = False
    weights[known] = state.weights
    if new.any():
        surface = earlier.problem.tree.at(state.moved)
        _, face, foot, bary = surface.query(data.points[new])
        corners = faces[face]
        normals = unit_mean(vertex_normals(state.moved, faces), corners, bary)
        outward = ((data.points[new] - foot) * normals).sum(axis=1)
        own = state.scales.errors(data.group[new], data.relative[new])
        variance = own**2 + (bary * earlier.sd[corners]).sum(axis=1) ** 2
        weights[new], _ = earlier.problem.contacts(outward, variance, data.outlier_odds[new], state.contact)
    return weights


def _run_and_preference(problem: MotionProblem) -> tuple[Iterated, Preference]:
    """Return the likeliest run and what the points prefer to it. Mostly the first run stays: that is asked
    of it while the other one is under way.
    """
    run = _iterate_rounds(problem, begin(problem))
    suspect = leverage_points(run)
    if not suspect.any():
        return run, preferred(run)
    preference, other = both(partial(preferred, run), partial(_without_at_first, problem, suspect))
    likelier = _likelier_run(run, other, suspect)
    return likelier, preferred(likelier) if likelier.state is other.state else preference


def _likeliest_run(problem: MotionProblem) -> Iterated:
    """Iterate; where points may have pulled the wall out, begin without them, take them in again, and return
    that run if it is clearly likelier.
    """
    run = _iterate_rounds(problem, begin(problem))
    suspect = leverage_points(run)
    return _likelier_run(run, _without_at_first(problem, suspect), suspect) if suspect.any() else run


def _likelier_run(run: Iterated, other: Iterated, suspect: Mask) -> Iterated:
    """Return the other run, begun without the suspect points (n,), if it is clearly likelier; with facts on
    both.
    """
    behind = energy_with_strain(other) - energy_with_strain(run)
    count = float(suspect.sum())
    if behind < -run.problem.settings.selection.decisive:
        return replace(other, facts={"excluded_points": count})
    apart = float(np.linalg.norm(other.state.moved - run.state.moved, axis=1).mean())
    facts = {"alternative_excluded": count, "alternative_behind": behind, "alternative_apart": apart}
    return replace(run, facts=facts)


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
    for last in _run_rounds(problem, state, anneal=anneal):
        trace.append(last.record)
    return Iterated(problem, last.state, last.solved, tuple(trace), trace[-1]["step"])


def _run_rounds(
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
