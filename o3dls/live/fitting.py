"""The estimate of a session: a full fit now and then, and between two of them what came since, put in by
`Deform.update`. The same full fit and the same points give the same estimate, however they came.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..case import FITTED_TYPES, Case
from ..errors import O3dlsError
from ..estimate import Estimate
from ..run_warning import each_once
from .session import LANDMARK, Point, Session

if TYPE_CHECKING:
    from ..pipeline.pipeline import Pipeline
    from ..stages.deform import Deform

FEWEST_POINTS = 10  # of type eam: fewer are not fitted
OUTDATED = "outdated-amplitudes"


@dataclass(frozen=True, eq=False)
class FullFit:
    """A full fit is made from nothing; it comes with the session as it was then; refused: why there is none,
    in words; lost: its process was ended from outside, so the same fit may well succeed.
    """

    session: Session
    estimate: Estimate | None = None
    refused: str = ""
    lost: bool = False


@dataclass(frozen=True, eq=False)
class Current:
    """This is the estimate as it is now, with the case that it is of, and the numbers of the points that it
    knows.

    outdated: whether a full fit should be made again.
    """

    case: Case
    estimate: Estimate
    fitted: frozenset[int]
    outdated: bool


def can_be_fitted(session: Session) -> bool:
    """Return whether there are points enough for a full fit."""
    return sum(point.type == "eam" for point in session.kept) >= FEWEST_POINTS


def prepare() -> None:
    """Have everything imported that a fit needs."""
    from ..motion.fit import fit_motion  # noqa: F401

    _make_plan()


def full_fit(session: Session) -> FullFit:
    """Make the estimate that the stage `deform` of a run on the session's case makes, with the warnings of
    that run so far; refused where the run would be.
    """
    case = session.case()
    plan = _make_plan().allowed_by(case)
    try:
        estimate = plan.judged(case)[plan.names[-1]]
    except O3dlsError as error:
        return FullFit(session, refused=str(error))
    return FullFit(session, replace(estimate, warnings=each_once(estimate.warnings)))


def current(fit: FullFit, now: Session) -> Current:
    """Update the estimate of a full fit by the points that came since.

    Where points or landmarks of the fit have changed it keeps them as they were, and is outdated. Raises
    SolverError where no motion can be solved for.
    """
    assert fit.estimate is not None
    known = _fitted_points(fit.session)
    stale = _is_stale(fit.session, now)
    session = _with_points_of(fit.session, now) if stale else now
    case = _order_points(session, list(known))
    estimate = fit.estimate
    if set(_fitted_points(session)) != set(known):
        estimate = _deform_stage().update(case, estimate)
    outdated = stale or any(warning.code == OUTDATED for warning in estimate.warnings)
    return Current(case, estimate, frozenset(_fitted_points(session)), outdated)


@lru_cache
def _make_plan() -> Pipeline:
    """Make the pipeline of the default stages as far as `deform`."""
    from ..pipeline.file import default_pipeline

    plan = default_pipeline()
    stages = plan.stages[: plan.names.index("deform")]
    return replace(plan, stages=stages, writes=(), folds=0)


def _deform_stage() -> Deform:
    from ..stages.deform import Deform

    stage = _make_plan().stages[-1]
    assert isinstance(stage, Deform)
    return stage


def _fitted_points(session: Session) -> dict[int, Point]:
    return {point.id: point for point in session.kept if point.type in FITTED_TYPES}


def _is_stale(then: Session, now: Session) -> bool:
    """Return whether something that a full fit was made of is another now; what the points measured beside is
    not looked at.
    """
    points = _fitted_points(now)
    changed = any(
        _fitted_values(points.get(number)) != _fitted_values(point)
        for number, point in _fitted_points(then).items()
    )
    return changed or _named_places(then) != _named_places(now) or then.pose != now.pose


def _fitted_values(point: Point | None) -> tuple[object, ...] | None:
    """Return what a fit sees of a point."""
    if point is None:
        return None
    return (point.xyz, point.type, point.values.get("sigma"), point.values.get("force"))


def _named_places(session: Session) -> tuple[object, ...]:
    named = {point.name: list(point.xyz) for point in session.kept if point.type == LANDMARK}
    return (session.landmarks | named, session.prior_landmarks)


def _with_points_of(then: Session, now: Session) -> Session:
    """Return the session of a full fit, with the points that came later; without landmarks that did."""
    late = {
        number: point
        for number, point in now.points.items()
        if number not in then.points and point.type != LANDMARK
    }
    return replace(then, points={**then.points, **late})


def _order_points(session: Session, first: list[int]) -> Case:
    """Return the case with some points, by their numbers, before all others."""
    case = session.case()
    place = {number: k for k, number in enumerate(first)}
    numbers = [int(one) if one else 0 for one in case.points.columns["id"].tolist()]
    behind = [place.get(number, len(first)) for number in numbers]
    return replace(case, points=case.points.select(np.argsort(behind, kind="stable")))
