"""Stage `phases`: a temporal template, several surfaces of one patient; where between them the data lie, and
the motion from there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from ..arrays import Array
from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry.similarity import apply, fit_similarity
from ..plugins.stage import Stage
from .deform import Deform

if TYPE_CHECKING:
    from ..motion.recorded import Motion
    from ..motion.template import Template


class Phases(Stage):
    """Find the phase of the heart between the prior and the case's further phases, then `deform` from there.

    The table `deform` has the parameters of that stage.
    """

    name: ClassVar[str] = "phases"
    variance: float = Field(
        default=0.98,
        gt=0.0,
        le=1.0,
        description="fraction of the phases' variance that the modes of the template keep",
        json_schema_extra={"unit": "1"},
    )
    pose_sd: float = Field(
        default=1.0,
        gt=0.0,
        description="how far the pose of the start may be off: phases and prior share one frame",
        json_schema_extra={"unit": "mm"},
    )
    # what has not converged by then does not
    iterations: int = Field(
        default=50, ge=1, le=10_000, description="most iterations of the search for the phase"
    )

    deform: Deform = Field(default_factory=Deform, description="the deformation from the phase that is found")

    @property
    def fits(self) -> tuple[str, ...]:
        return self.deform.fits

    def obstacle(self, case: Case) -> str | None:
        return (
            None
            if case.phases
            else "no further phases: put surfaces of the same patient, in the prior's frame, into phases/"
        )

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..motion.template import locate

        if why := self.obstacle(case):
            raise InputError(f"case {case.name}: {why}")
        model = self._make_template(case)
        found = locate(model, start.T_map_prior, case.points.of("eam").xyz)
        fitted, motion = self._deform_phase(case, start, found.pose, model.shape(found.c))
        phase = model.between(found.c)
        stopped = "" if found.converged else f" (stopped after {len(found.trace)} iterations)"
        path = f"phase {phase:.2f} on the path through {len(case.phases) + 1} phases{stopped}"
        return replace(
            fitted,
            T_map_prior=fit_similarity(case.prior.vertices, fitted.surface.vertices),
            status=f"{path}; then {fitted.status}",
            converged=found.converged and fitted.converged,
            iterations=len(found.trace) + fitted.iterations,
            motion=motion,
            trace=(*found.trace, *fitted.trace),
            facts={**fitted.facts, "phase": phase, "modes": len(found.c), "coefficients": found.c.tolist()},
        )

    def _make_template(self, case: Case) -> Template:
        from ..motion.settings import TemplateSettings
        from ..motion.template import template

        prior = case.prior
        phases = [(phase.vertices, phase.faces) for phase in case.phases]
        settings = TemplateSettings(variance=self.variance, pose_sd=self.pose_sd, iterations=self.iterations)
        return template(prior.vertices, prior.faces, phases, settings)

    def _deform_phase(
        self, case: Case, start: Estimate, pose: Array, shape: Array
    ) -> tuple[Estimate, Motion | None]:
        """Return the estimate of `deform` from the prior's vertices (n, d) in the phase found, and the motion
        from the prior as it was given.
        """
        from ..geometry.closest_point import ClosestPoint
        from ..motion.template import Chain, Shift

        prior = case.prior
        here = replace(start, surface=prior.with_vertices(apply(pose, shape)), T_map_prior=pose)
        shift = Shift(ClosestPoint(prior.vertices, prior.faces), prior.faces, shape - prior.vertices)
        marks = {mark: shift(at[None])[0] for mark, at in case.prior_landmarks.items()}
        fitted = self.deform(replace(case, prior=prior.with_vertices(shape), prior_landmarks=marks), here)
        return fitted, fitted.motion and Chain(shift, fitted.motion)
