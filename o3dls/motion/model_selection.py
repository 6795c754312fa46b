"""What the points prefer, by free energy: a motion or the pose alone, the prior as it is or smoothed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..geometry.differential import vertex_normals
from ..geometry.fairing import fair, roughness
from ..geometry.fold_repair import repair_folds
from ..geometry.similarity import apply, fit_similarity
from .field.covariance import Places
from .field.gaussian_process import solve
from .field.marginal_likelihood import MarginalLikelihood, Scales, free_energy, tune_noise
from .field.observations import points_left_out
from .iteration import State, begin, believe, contact_energy, find_feet, gather_rows, step
from .problem import MotionProblem, Smoothed
from .result import Iterated

MOST_NATS = 500.0  # nats beyond which a probability rounds to 0 or 1


@dataclass(frozen=True, eq=False)
class MotionEvidence:
    """The evidence gives the posterior probability of a motion beyond the pose; the start pose (d+1, d+1),
    `corrected` where another explains the points better; scales, whose noise levels are between those with
    and without the motion by that probability; `FittedMotion.pose_alone`.
    """

    probability: float
    pose: Array
    corrected: bool
    scales: Scales
    pose_alone: Array


@dataclass(frozen=True, eq=False)
class PoseFit:
    """This fit explains the points by pose and noise alone: free energy, Laplace's correction to it,
    similarity (d+1, d+1) from the start pose, noise levels.
    """

    energy: float
    correction: float
    similarity: Array
    noises: Array


Preference = tuple[MotionEvidence, Smoothed | None]


def preferred(run: Iterated) -> Preference:
    """Whether the points show a motion, and the prior as they would have it smoothed, if they would: points
    that show no motion show no roughness either.
    """
    found = motion_evidence(run)
    return found, preferred_smoothing(run) if found.probability == 1.0 else None


def motion_evidence(run: Iterated) -> MotionEvidence:
    """Return whether the points show a motion at all: evidences with and without it, amplitudes and noise
    levels integrated out (Laplace).
    """
    problem = run.problem
    settings = problem.settings.selection
    scales = run.state.scales
    stay = np.eye(len(problem.pose))
    certain = MotionEvidence(1.0, problem.pose, False, scales, stay)
    clear = run.energy + settings.decisive + settings.motion_log_odds
    alone = fit_pose(problem, free=True, clear=clear)
    if alone.energy > clear:
        return certain
    correction = MarginalLikelihood.of(problem.covariance, run.solved.rows).laplace(scales)
    against = run.energy + correction - alone.energy - alone.correction + settings.motion_log_odds
    probability = float(1.0 / (1.0 + np.exp(np.clip(against, -MOST_NATS, MOST_NATS))))
    if probability > settings.certain:
        return certain
    log = scales.log.copy()
    mixed = probability * scales.noises**2 + (1.0 - probability) * alone.noises**2
    log[scales.amplitudes :] = 0.5 * np.log(mixed)
    corrected = alone.energy + settings.decisive < fit_pose(problem, free=False, clear=np.inf).energy
    pose = alone.similarity @ problem.pose if corrected else problem.pose
    # points alone have had their say on the pose in the start; as many landmarks as fix a pose say more
    fixed = len(problem.marks) >= problem.vertices.shape[1]
    pose_alone = alone.similarity if fixed else stay
    return MotionEvidence(probability, pose, corrected, replace(scales, log=log), pose_alone)


def fit_pose(problem: MotionProblem, *, free: bool, clear: float) -> PoseFit:
    """Return the noise around the prior in a pose that is free to move, or not.

    Rounds end early once further ones cannot bring the energy below `clear`: while beliefs are steady, drops
    shrink by a quarter or more a round; a point that is given up can bring any drop.
    """
    settings = problem.settings.selection
    state = begin(problem)
    rest = problem.rest.at
    energy = np.inf
    state = replace(state, scales=state.scales.noise_alone())
    features = float(free) * problem.covariance.similarity(rest)
    for _ in range(settings.pose_rounds):
        feet = find_feet(problem, state)
        rows = gather_rows(problem, feet, state)
        directions = rows.observed.directions
        seen = float(free) * np.einsum(
            "na,nak->nk", directions, problem.covariance.similarity(rows.observed.at)
        )
        likelihood = MarginalLikelihood(seen @ seen.T, [], rows)
        scales = replace(state.scales, log=tune_noise(state.scales, seen, rows, problem.settings.iteration))
        matrix, noise = likelihood.covariance(scales.log)
        posterior, _ = solve(matrix, rows.residual)
        own = problem.data.noise(scales.noises)
        out = points_left_out(rows, feet, state.weights, noise, posterior.left_out(noise), own)
        weights, contact = believe(problem, state, *out)
        before = energy
        labels = contact_energy(problem, state.weights, out[0], contact, scales.noises)
        energy = free_energy(posterior, scales.log, rows) + labels
        steady = np.abs(weights - state.weights).sum() < settings.steady_points
        # a rotation by small angles would swell the prior
        similarity = fit_similarity(rest, rest + features @ (posterior.alpha @ seen))
        state = replace(
            state, feet_on=apply(similarity, rest), scales=scales, weights=weights, contact=contact
        )
        drop = before - energy
        if steady and (abs(drop) < settings.steady_energy or energy - settings.pose_decay * drop > clear):
            break
    return PoseFit(energy, likelihood.laplace(state.scales), similarity, state.scales.noises)


def preferred_smoothing(run: Iterated) -> Smoothed | None:
    """Return the prior as the points would have it smoothed, if they would.

    A smoother prior is tried where the fit has come to, with its motion, noise and beliefs: detail that the
    wall has is missed at once there, before another motion could make up for it. As much as the best length
    must gain, none may lose.
    """
    problem = run.problem
    settings = problem.settings.selection
    at = problem.rest.at
    most = run.energy + settings.smoothing_evidence
    lengths = sorted((problem.size * x for x in settings.smoothing_lengths), reverse=True)
    # normals of a smooth wall: a wall of stairs would fold at every step along its own normals
    normals = vertex_normals(at - problem.rough, problem.faces)
    smoother = list[Array]()
    for length in lengths:
        smoother.append(fair(at, roughness(at, problem.faces, length), normals))
        # most walls are dismissed here, before folds are searched for, which takes time
        if _trial_energy(problem, run.state, smoother[-1]) > most + settings.decisive:
            return None
    found = list[tuple[float, float, Array]]()
    for length, smooth in zip(reversed(lengths), reversed(smoother), strict=True):
        smooth = repair_folds(at, smooth, problem.faces)[0]  # parts thinner than the length have folded
        found.append((_trial_energy(problem, run.state, smooth), length, smooth))
        if found[-1][0] > most:
            return None
    best = min(found, key=lambda one: one[0], default=None)
    return best[1:] if best is not None and best[0] < run.energy - settings.smoothing_evidence else None


def _trial_energy(problem: MotionProblem, state: State, at: Array) -> float:
    """Return the free energy of a prior whose vertices rest at `at`, after a few rounds from a state of this
    one.
    """
    tried = replace(problem, rest=Places(at, vertex_normals(at, problem.faces)))
    state = replace(state, feet_on=at + state.moved - problem.rest.at, past=())
    for _ in range(problem.settings.selection.trial_rounds):
        state, _, record = step(tried, state, None)
    return record["energy"]
