"""Find the part of a map that is shifted: two maps in one, whose frames differ by an offset.

Where an offset gains evidence in closed form (`offset_model`), a motion is fitted without it, and judged by
its free energy; offset and cut follow anew until they stay. What only one place of the wall speaks for is no
shift (`one_place`). Reasons and numbers: docs/method_decisions.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...arrays import Array
from ...geometry.similarity import apply, fit_similarity
from ...noise.shifted_part import MapShift
from ...parallel import both, each, once, one_blas_thread
from ..field.observations import Data
from ..iteration import State
from ..problem import MotionProblem, motion_problem
from ..result import Iterated, MotionFit
from .offset_model import Offset, best_offsets, cut_at, offset_model, order_of
from .one_place import is_shared
from .trial import Trial, energy_alone, fitted_without, log_likelihood


def find_map_shift(fit: MotionFit) -> tuple[MapShift, Array] | None:
    """Return the part of the map that one offset explains better than any motion does, and the pose (d+1,
    d+1) that the prior comes to without the offset; None where there is no such part.
    """
    with one_blas_thread():
        problem, state, energy = _sample_problem(fit)
        trials = [trial for trial in _try_offsets(problem, state, energy) if _stands_out(trial)]
        if not trials:
            return None
        trial = max(trials, key=lambda one: one.evidence)
        # further cuts part the same points elsewhere: where the likeliest cut is one place, none replaces it
        if not is_shared(trial, problem, state):
            return None
    found, data = trial.found, fit.problem.data
    mapping = (data.group == 0) & ~data.inside if data.mapping is None else data.mapping
    held = found.part.holds(data.points, order_of(data))[mapping]
    sd = fit.problem.settings.inflation * np.sqrt(np.diag(found.covariance))
    shift = MapShift(found.part, found.offset, sd, trial.evidence, int(held.sum()), len(held))
    pose = _pose_problem(trial.run).pose
    if not _seen_from_the_wrong_side(shift, len(data.marks_map) > 0):
        return shift, pose
    pose[:-1, -1] += shift.offset
    return shift.other_side(), pose


def _try_offsets(problem: MotionProblem, state: State, energy: float | None) -> list[Trial]:
    """Try the offsets that are worth a fit: return the motions without them. energy: of the problem, if it is
    known.
    """
    settings = problem.settings.map_shift
    here, measured = offset_model(problem, state), problem.data
    motion = _rms_motion(problem, state)
    worth = [one for one in best_offsets(here, measured) if _worth_a_fit(problem, motion, one)]
    # a shift that begins at a time is usual, but it hides while all points pull at one surface
    in_order = [one for one in worth if one.part.direction is None]
    planes = [one for one in worth if one.part.direction is not None]
    rivals = settings.rivals if len(measured.points) >= settings.least_points else 0
    asked = in_order + planes[:rivals]
    if not asked:
        return []

    alone = once(lambda: energy_alone(problem) if energy is None else energy + here.correction)
    _, trials = both(alone, lambda: each(lambda one: _settle_offset(problem, measured, one, alone), asked))
    return trials


def _settle_offset(
    problem: MotionProblem, measured: Data, found: Offset, alone: Callable[[], float]
) -> Trial:
    """The trial of an offset after as many rounds as it and its cut need to stay, or as it is worth.

    measured: the points with the offset in them; alone: tells the free energy of a motion alone.
    """
    settings = problem.settings.map_shift
    trial = fitted_without(problem, measured, found, alone)
    for _ in range(1, settings.rounds):
        again = _sharpen_cut(trial, measured, best_offsets(trial.model, measured, trial.found)[0])
        still = settings.settled * float(trial.run.state.scales.noises[0])
        if np.linalg.norm(again.offset - trial.found.offset) < still:
            break
        trial = fitted_without(_pose_problem(trial.run), measured, again, alone)
        if not _stands_out(trial, settings.hopeless):
            break
    return trial


def _sample_problem(fit: MotionFit) -> tuple[MotionProblem, State, float | None]:
    """Return problem and state for an even part of the points where they are more than may have rows of their
    own, and their free energy if it is known.
    """
    problem, state = fit.problem, fit.state
    data = replace(problem.data, order=order_of(problem.data))
    kinds = len(np.unique(2 * data.group + data.inside))
    some = data.part(problem.settings.iteration.most_rows // kinds)
    every = len(some) == len(data.points)
    state = replace(state.without_history(), weights=state.weights[some])
    return replace(problem, data=data.at(some)), state, fit.energy if every else None


def _worth_a_fit(problem: MotionProblem, motion: float, found: Offset) -> bool:
    """Return whether an offset in closed form may come to stand out. One by a plane must be as long as those
    that may be named, and clearly longer than the rms motion of the whole map, which follows it partly.
    """
    settings = problem.settings.map_shift
    if found.part.direction is None:
        return found.nats >= settings.first_in_order and found.length >= settings.first_offset * problem.size
    least = max(settings.least_offset * problem.size, settings.first_over_motion * motion)
    return found.nats >= settings.first_evidence and found.length >= least


def _stands_out(trial: Trial, share: float = 1.0) -> bool:
    """Return whether an offset has the evidence that it needs, or a share of it; one by a plane must also be
    longer than the motions are that resemble it, and the more so the longer it is.
    """
    settings = trial.problem.settings.map_shift
    enough = max(settings.evidence, settings.evidence_per_point * len(trial.problem.data.points))
    if trial.evidence < share * enough or trial.found.part.direction is None:
        return trial.evidence >= share * enough
    over = settings.over_motion * max(trial.found.length / (settings.large_offset * trial.problem.size), 1.0)
    usual = over * _rms_motion(trial.problem, trial.run.state)
    long = max(settings.least_offset * trial.problem.size, usual)
    return trial.found.length >= share * long


def _rms_motion(problem: MotionProblem, state: State) -> float:
    """Return the root mean square of how far the vertices moved beyond a similarity."""
    rest, moved = problem.rest.at, state.moved
    return float(np.sqrt(((moved - apply(fit_similarity(rest, moved), rest)) ** 2).sum(axis=1).mean()))


def _pose_problem(run: Iterated) -> MotionProblem:
    """Return the problem of a run in the pose that it came to: the earlier pose was found with the offset."""
    problem = run.problem
    moved = fit_similarity(problem.rest.at, run.state.moved)
    length = problem.smoothing_length
    smoothed = (length, apply(moved, problem.rest.at)) if length else None
    return motion_problem(
        problem.vertices, problem.faces, moved @ problem.pose, problem.data, problem.settings, smoothed
    )


def _sharpen_cut(trial: Trial, measured: Data, found: Offset) -> Offset:
    """Move the cut of an offset to where the points are likeliest to have the offset or not, by their
    distances from the surface.
    """
    settings = trial.problem.settings.map_shift
    key = found.part.key(measured.points, order_of(measured))
    problem, state = trial.problem, trial.run.state
    with_it = log_likelihood(problem, state, measured.points - found.offset)
    gain = with_it - log_likelihood(problem, state, measured.points)
    rows = np.argsort(key, kind="stable")
    beyond = np.cumsum((gain * ~measured.inside)[rows][::-1])[::-1]
    few = max(int(settings.least_part * len(rows)), 1)
    cut = few + int(np.argmax(beyond[few : len(rows) - few]))
    return found._replace(part=cut_at(found.part, key, rows, cut))


def _seen_from_the_wrong_side(shift: MapShift, marks: bool) -> bool:
    """Return whether it is the other side of a plane that is shifted: the one that has not the landmarks or,
    where these are on both, the smaller one.
    """
    part = shift.part
    if part.direction is None or (marks and part.landmarks == "stay"):
        return False
    return part.landmarks == "move" or 2 * shift.points > shift.total
