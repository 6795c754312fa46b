"""Find errors of the points that go together along their order, and fit the motion anew with them.

A motion follows them where it does not know them, and its deviation is too small. The model is `field.drift`;
whether errors go together is decided by evidence, so that maps with independent errors keep their fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..parallel import one_blas_thread
from .field.marginal_likelihood import MarginalLikelihood, Scales
from .field.observations import Rows
from .iteration import State, find_feet, gather_rows, rows_in_order, step
from .problem import MotionProblem
from .result import Iterated, MotionFit, motion_fit


def fit_with_drift(fit: MotionFit) -> MotionFit | None:
    """Return the fit gone on from with errors that go together; None where the points do not show any, or are
    too many in no order in space to be asked.
    """
    problem, settings = fit.problem, fit.problem.settings.drift
    if (~problem.data.inside).sum() < settings.least_points:
        return None
    with one_blas_thread():
        feet = find_feet(problem, fit.state)
        if (patches := rows_in_order(problem, feet)) is None:
            return None
        scales = _with_drift(fit.state.scales, problem)
        state = replace(fit.state.without_history(), scales=scales, patches=patches)
        rows = gather_rows(problem, feet, state)
        tuned = _tuned_by_evidence(problem, state.scales, fit.state.scales, rows)
        return None if tuned is None else _go_on(fit, replace(state, scales=tuned))


def _with_drift(scales: Scales, problem: MotionProblem) -> Scales:
    """Return the scales with a usual deviation of each offset that goes together."""
    settings = problem.settings.drift
    drifts = len(settings.names)
    at = scales.fields

    def extended(values: Array, more: float) -> Array:
        return np.insert(values, at, np.full(drifts, more))

    usual = float(np.log(settings.usual * problem.size))
    return Scales(
        extended(scales.log, usual),
        extended(scales.prior_log, usual),
        extended(scales.prior_log_sd, settings.log_sd),
        extended(scales.least, -np.inf),
        at,
        drifts,
    )


def _tuned_by_evidence(problem: MotionProblem, drifting: Scales, alone: Scales, rows: Rows) -> Scales | None:
    """Return the likeliest scales with errors that go together, if these have the evidence that they need
    over independent ones. Most maps are dismissed by the slope of the evidence.
    """
    iteration, settings = problem.settings.iteration, problem.settings.drift
    independent = MarginalLikelihood.of(problem.covariance, replace(rows, drift=()))
    pulls = [independent.pull(alone.log, part) for part in rows.drift]
    if max(pulls) < settings.least_pull:
        return None
    together = MarginalLikelihood.of(problem.covariance, rows)
    alone = replace(alone, log=independent.maximise(alone, iteration))
    drifting = replace(drifting, log=together.maximise(drifting, iteration))
    gain = independent.energy(alone) - together.energy(drifting)
    return drifting if gain >= settings.evidence else None


def _go_on(fit: MotionFit, state: State) -> MotionFit:
    """Run rounds from a state until the surface stands still."""
    problem = fit.problem
    least = problem.settings.iteration.tolerance * problem.size
    trace = list[dict[str, float]]()
    for _ in range(problem.settings.iteration.iterations):
        state, solved, record = step(problem, state, None)
        trace.append(record)
        if record["step"] < least:
            break
    moving = fit.motion.probability * trace[-1]["step"]
    run = Iterated(problem, state, solved, (*fit.trace, *trace), moving, fit.facts)
    return motion_fit(run, fit.motion.probability, fit.motion.pose_alone, least)


def with_doubt(fit: MotionFit, doubt: float) -> MotionFit:
    """Return the fit whose deviation allows for errors that points share unseen, of the deviation `doubt`."""
    return replace(fit, motion=replace(fit.motion, doubt=doubt), sd=np.hypot(fit.sd, doubt)) if doubt else fit


def lost_order(fit: MotionFit) -> float | None:
    """Return the deviation of the detail that the wall took on, where errors that neighbours share may be in
    it unseen: the points come in no order in space, and there is much of it. None where that is not so.
    """
    problem, settings = fit.problem, fit.problem.settings.drift
    data, lengths = problem.data, problem.covariance.lengths
    touching = np.flatnonzero(~data.inside)
    if fit.state.scales.drifts or data.moment is not None or len(touching) < settings.least_points:
        return None
    short = lengths == lengths.min()
    detail = float(np.linalg.norm(fit.state.scales.sds[: len(lengths)][short]))
    in_order = data.points[touching[np.argsort(data.place_in_order[touching])]]
    # the same points, each followed by one that has nothing to do with it
    anyhow = in_order[np.random.default_rng(0).permutation(len(in_order))]
    step, between = (np.median(np.linalg.norm(np.diff(x, axis=0), axis=1)) for x in (in_order, anyhow))
    lost = step > settings.scattered * between and detail > settings.detail * float(lengths.min())
    return detail if lost else None
