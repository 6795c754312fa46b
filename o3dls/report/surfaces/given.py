"""Poses of the prior: that in which it was given, for runs that begin with a fit of landmarks, and those that
stages found.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ...estimate import Estimate
from ...geometry.similarity import apply, fit_similarity
from ...geometry.surface import Surface
from ...runs.run import Run
from ...runs.scoring import score_sets, with_distances, with_held_out

GIVEN = "given"
STATUS = "the prior in the pose in which it was given"
POSED = 1e-4  # of a surface's size: surfaces are written as single numbers
SAME = 1e-6  # of the prior's size: less is no other pose


def with_given(run: Run) -> Run:
    """Return the run with the estimate `given` before all others: the prior as the case has it, by its init
    matrix where there is one. The run itself is returned where `start` is that pose: where landmarks were
    fitted it is another, and a gain over `start` hides what they brought.
    """
    case, start = run.case, run.estimates["start"]
    T = np.eye(case.dimension + 1) if case.init is None else case.init
    prior = case.prior.vertices
    step = np.linalg.norm(apply(T, prior) - apply(start.T_map_prior, prior), axis=1).max()
    if GIVEN in run.estimates or step < SAME * case.prior.diagonal:
        return run
    given = {GIVEN: Estimate(case.prior.transformed(T), T, STATUS)}
    fitted = run.fitted.get("start", ())
    column = f"distance_{GIVEN}_{run.unit}"
    far = with_distances(case, given, {}).columns[column]
    held_out, judged = run.held_out, with_held_out(case, given)
    if held_out is not None and judged is not None:
        held_out = replace(held_out, columns={**held_out.columns, column: judged.columns[column]})
    return replace(
        run,
        estimates={**given, **run.estimates},
        fitted={GIVEN: fitted, **run.fitted},
        scores={GIVEN: score_sets(case, given[GIVEN], fitted), **run.scores},
        validity={GIVEN: run.validity["start"], **run.validity},
        points=replace(run.points, columns={**run.points.columns, column: far}),
        held_out=held_out,
        ends_with=run.final,
    )


@lru_cache(maxsize=16)
def found_poses(run: Run) -> frozenset[str]:
    """Return the names of the estimates in which a stage brought the prior into a pose and did no more."""
    prior = run.case.prior
    return frozenset(
        name
        for name, one in run.estimates.items()
        if name not in before_stages(run) and _is_posed(prior, one.surface)
    )


def _is_posed(prior: Surface, surface: Surface) -> bool:
    """Say whether a surface is the prior, but for a similarity."""
    if surface.vertices.shape != prior.vertices.shape:
        return False
    fitted = apply(fit_similarity(prior.vertices, surface.vertices), prior.vertices)
    return bool(np.linalg.norm(fitted - surface.vertices, axis=1).max() < POSED * surface.diagonal)


def before_stages(run: Run) -> dict[str, str]:
    """Say by its name what each estimate stands for that no stage made."""
    if GIVEN in run.estimates:
        return {GIVEN: "before registration", "start": "landmarks fitted rigidly"}
    return {"start": "before registration"}
