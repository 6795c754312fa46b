"""Stage `phases`: a temporal template, several surfaces of one patient; where between them the data lie, and
the motion from there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry.similarity import apply, fit_similarity
from ..plugins.stage import Stage
from .deform import Deform


class Phases(Stage):
    """Find the phase of the heart that the points show between the prior and the case's further phases, then
    `deform` from there.
    """

    name: ClassVar[str] = "phases"
    variance: float = Field(
        0.98,
        gt=0.0,
        le=1.0,
        description="share of the phases' variance that the modes of the template keep",
        json_schema_extra={"unit": "1"},
    )
    pose_sd: float = Field(
        1.0,
        gt=0.0,
        description="how far the pose of the start may be off: phases and prior share one frame",
        json_schema_extra={"unit": "mm"},
    )
    iterations: int = Field(50, ge=1, description="most iterations in finding the phase")

    def obstacle(self, case: Case) -> str | None:
        return (
            None
            if case.phases
            else "no further phases: put surfaces of the same patient, in the prior's frame, into phases/"
        )

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..geometry.closest_point import ClosestPoint
        from ..motion.settings import TemplateSettings
        from ..motion.template import Chain, Shift, locate, template

        if why := self.obstacle(case):
            raise InputError(f"case {case.name}: {why}")
        prior = case.prior
        model = template(
            prior.vertices,
            prior.faces,
            [(phase.vertices, phase.faces) for phase in case.phases],
            TemplateSettings(variance=self.variance, pose_sd=self.pose_sd, iterations=self.iterations),
        )
        found = locate(model, start.T_map_prior, case.points.of("eam").xyz)
        shape = model.shape(found.c)
        here = replace(start, surface=prior.with_vertices(apply(found.pose, shape)), T_map_prior=found.pose)
        shift = Shift(ClosestPoint(prior.vertices, prior.faces), prior.faces, shape - prior.vertices)
        marks = {mark: shift(at[None])[0] for mark, at in case.prior_landmarks.items()}
        fitted = Deform()(replace(case, prior=prior.with_vertices(shape), prior_landmarks=marks), here)
        place = model.between(found.c)
        word = "" if found.converged else f", stopped after {len(found.trace)} iterations"
        return replace(
            fitted,
            T_map_prior=fit_similarity(prior.vertices, fitted.surface.vertices),
            status=(
                f"at {place:.2f} on the way through {len(case.phases) + 1} phases{word}; then {fitted.status}"
            ),
            converged=found.converged and fitted.converged,
            iterations=len(found.trace) + fitted.iterations,
            motion=fitted.motion and Chain(shift, fitted.motion),
            trace=(*found.trace, *fitted.trace),
            facts={**fitted.facts, "phase": place, "modes": len(found.c), "coefficients": found.c.tolist()},
        )
