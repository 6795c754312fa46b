"""Stage `global_pose`: the pose of the prior when there is no start: no landmarks, any rotation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..plugins.stage import Stage
from ..run_warning import RunWarning
from .icp import as_estimate, fitted_places
from .pose_checks import STARTS, better_mirrored

if TYPE_CHECKING:
    from ..arrays import Array
    from ..registration.global_pose import Candidate


class GlobalPose(Stage):
    """Search all rotations for the pose in which the prior fits the points, and give its confidence against
    the second-best pose.
    """

    name: ClassVar[str] = "global_pose"
    finds_pose: ClassVar[bool] = True
    starts: int = Field(
        default=STARTS, ge=24, le=100_000, description="number of rotations tried, evenly distributed"
    )
    scale: bool = Field(
        default=True, description="estimate the scale too: a similarity instead of a rigid motion"
    )
    hands: bool = Field(
        default=True,
        description="try the mirror image too, and refuse the prior where that fits clearly better",
    )
    sure: float = Field(
        default=0.95,
        ge=0.5,
        le=1.0,
        description="confidence below which the estimate counts as not converged",
        json_schema_extra={"unit": "1"},
    )

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..registration.global_pose import candidates, confidence, mirrored
        from ..registration.match import SurfaceMatcher

        points, place = fitted_places(case)
        surface = SurfaceMatcher(case.prior)
        best, *others = candidates(points, surface, starts=self.starts, scale=self.scale)
        if self.hands:
            other_hand = candidates(points, mirrored(surface), starts=self.starts, scale=self.scale)[0]
            if better := better_mirrored(case.units, points, best, other_hand):
                raise InputError(f"case {case.name}: {better}")
        sure = min([confidence(best.costs, other.costs, points) for other in others], default=1.0)
        return self._judge_pose(
            as_estimate(case, best.alignment, place, scale=self.scale), best, others, sure
        )

    def _judge_pose(
        self, estimate: Estimate, best: Candidate, others: list[Candidate], sure: float
    ) -> Estimate:
        """Return the estimate with what the search knows about the second-best pose."""
        runner = _runner_up(best.T_map_prior, others)
        status = f"pose found with confidence {sure:.2f}{runner and f'; {runner}'}; ICP {estimate.status}"
        sentence = f"the pose is not certain (confidence {sure:.2f}; {runner}): check it, or give landmarks"
        uncertain = (RunWarning("uncertain-pose", sentence),) if sure < self.sure else ()
        return replace(
            estimate,
            status=status,
            converged=estimate.converged and sure >= self.sure,
            warnings=(*estimate.warnings, *uncertain),
            facts={
                **estimate.facts,
                "confidence": sure,
                "candidates": [_record_candidate(best.T_map_prior, c) for c in (best, *others)],
            },
        )


def _runner_up(T_map_prior: Array, others: list[Candidate]) -> str:
    from ..registration.global_pose import angle_of

    if not others:
        return ""
    degrees = np.degrees(angle_of(T_map_prior, others[0].T_map_prior))
    return f"the second-best pose is {degrees:.0f} degrees away"


def _record_candidate(T_map_prior: Array, candidate: Candidate) -> dict[str, float]:
    from ..registration.global_pose import angle_of

    distances = candidate.alignment.pairs.distances
    return {
        "degrees_away": float(np.degrees(angle_of(T_map_prior, candidate.T_map_prior))),
        "cost": float(candidate.costs.mean()),
        "median": float(np.median(distances)),
    }
