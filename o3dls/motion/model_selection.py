"""What the points prefer, by free energy: a motion or the pose alone, the prior as it is or smoothed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..geometry.differential import vertex_normals
from ..geometry.fairing import fair, roughness
from ..geometry.fold_repair import unfold
from ..geometry.similarity import apply, fit_similarity
from .covariance import Places, grams
from .marginal_likelihood import Scales, assemble, flattery, free_energy, left_out, solve, tune_noise
from .observations import points_left_out
from .problem import LATE, Faired, Problem, Run
from .result import State

# a motion this probable is a motion; a pose better by so many nats is the pose
CERTAIN, DECISIVE = (
    0.999,
    10.0,
)
GLIMPSE_ROUNDS = 2  # the first one still has the feet of the rougher surface
ALONE_ROUNDS = 12
STEADY = 0.5  # points: total change of belief in a round
SAME = 0.2  # nats: less than any decision turns on


@dataclass(frozen=True, eq=False)
class Shown:
    """Posterior probability of a motion beyond the pose; the start pose (d+1, d+1), mended where another
    explains the points better; scales, whose noise levels are between those with and without the motion by
    that probability; `Motion.alone`.
    """

    share: float
    pose: Array
    mended: bool
    scales: Scales
    alone: Array


@dataclass(frozen=True, eq=False)
class _Alone:
    """The pose and noise alone: free energy, what tuning flatters it by, similarity (d+1, d+1) from the start
    pose, noise levels.
    """

    energy: float
    flattery: float
    similarity: Array
    noises: Array


def shown(run: Run) -> Shown:
    """Whether the points show a motion at all: evidences with and without it, amplitudes and noise levels
    integrated out (Laplace).
    """
    problem = run.problem
    scales = run.state.scales
    odds = run.problem.settings.odds
    stay = np.eye(len(problem.pose))
    certain = Shown(1.0, problem.pose, False, scales, stay)
    alone = _pose_alone(problem, 1.0, run.energy + DECISIVE + odds)
    if alone.energy > run.energy + DECISIVE + odds:
        return certain
    rows = run.solved[0]
    against = (
        run.energy
        + flattery(scales, *grams(problem.covariance, rows.observed), rows)
        - alone.energy
        - alone.flattery
        + odds
    )
    share = float(1.0 / (1.0 + np.exp(np.clip(against, -500.0, 500.0))))
    if share > CERTAIN:
        return certain
    log = scales.log.copy()
    log[scales.fields :] = 0.5 * np.log(share * scales.noises**2 + (1.0 - share) * alone.noises**2)
    mended = alone.energy + DECISIVE < _pose_alone(problem, 0.0, np.inf).energy
    pose = alone.similarity @ problem.pose if mended else problem.pose
    # points alone have had their say on the pose in the start; as many landmarks as fix a pose say more
    fixed = len(problem.marks) >= problem.vertices.shape[1]
    return Shown(share, pose, mended, replace(scales, log=log), alone.similarity if fixed else stay)


def _pose_alone(problem: Problem, free: float, clear: float) -> _Alone:
    """Noise around the prior in a pose that is `free` to move (1) or not (0).

    Rounds end early once further ones cannot bring the energy below `clear`: while beliefs are steady, drops
    shrink by a quarter or more a round; a point let go can bring any drop.
    """
    state = problem.start()
    rest = problem.rest.at
    energy = np.inf
    state = replace(state, scales=state.scales.noise_alone())
    features = free * problem.covariance.similarity(rest)
    for _ in range(ALONE_ROUNDS):
        feet = problem.feet(state)
        rows = problem.rows(feet, state)
        seen = free * np.einsum(
            "na,nak->nk", rows.observed.directions, problem.covariance.similarity(rows.observed.at)
        )
        fixed = seen @ seen.T
        scales = replace(state.scales, log=tune_noise(state.scales, seen, rows))
        matrix, noise = assemble(scales.log, fixed, [], rows)
        posterior, _ = solve(matrix, rows.residual)
        residual, var = points_left_out(
            rows, feet, state.weights, noise, *left_out(posterior, noise), scales.noises, problem.data
        )
        weights, contact = problem.believe(state, residual, var)
        before = energy
        energy = free_energy(posterior, scales.log, rows) + problem.label_energy(
            state.weights, residual, contact, scales.noises
        )
        steady = np.abs(weights - state.weights).sum() < STEADY
        # a rotation by small angles would swell the prior
        similarity = fit_similarity(rest, rest + features @ (posterior.alpha @ seen))
        state = replace(
            state, feet_on=apply(similarity, rest), scales=scales, weights=weights, contact=contact
        )
        if steady and (abs(before - energy) < SAME or energy - 3.0 * (before - energy) > clear):
            break
    return _Alone(energy, flattery(state.scales, fixed, [], rows), similarity, state.scales.noises)


def smoother(run: Run) -> Faired | None:
    """The prior as the points would have it smoothed, if they would.

    A smoother prior is looked at where the fit has come to, with its motion, noise and beliefs: detail that
    the wall has is missed at once there, before another motion could make up for it. As much as the best
    length must gain, none may lose.
    """
    problem = run.problem
    settings = run.problem.settings
    at = run.problem.rest.at
    found = list[tuple[float, float, Array]]()
    most = run.energy + settings.fairing_nats
    # a smooth wall's: along its own, one of stairs folds at every step
    normals = vertex_normals(at - problem.rough, problem.faces)
    for length in sorted(problem.size * x for x in settings.fairing):
        smooth = fair(at, roughness(at, problem.faces, length), normals)
        # most walls end here, before folds take their time
        if not found and _glimpse(problem, run.state, smooth) > most:
            return None
        smooth = unfold(at, smooth, problem.faces)[0]  # parts thinner than the length have folded
        found.append((_glimpse(problem, run.state, smooth), length, smooth))
        if found[-1][0] > most:
            return None
    best = min(found, key=lambda one: one[0], default=None)
    return best[1:] if best is not None and best[0] < run.energy - settings.fairing_nats else None


def _glimpse(problem: Problem, state: State, at: Array) -> float:
    """Free energy of a prior whose vertices rest at `at`, after a few rounds from a state of this one."""
    seen = replace(problem, rest=Places(at, vertex_normals(at, problem.faces)))
    state = replace(state, feet_on=at + state.moved - problem.rest.at)
    for _ in range(GLIMPSE_ROUNDS):
        state, _, record = seen.step(state, LATE, tuning=False)
    return record["energy"]
