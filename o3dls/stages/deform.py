"""Stage `deform`: the smooth non-rigid motion T of the prior, with its posterior; amplitudes and noise set by
the evidence.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..arrays import Array
from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..evaluation.trusted_landmarks import trusted_pairs
from ..geometry.similarity import fit_similarity
from ..geometry.surface import Surface
from ..registration.landmarks import determined
from ..run_warning import RunWarning, of_stage
from .deform_checks import (
    POINT_CODES,
    allow_for_lost_order,
    alternatives,
    another_heart,
    motion_warnings,
    order_lost,
    point_warnings,
    shifted,
)
from .deform_data import case_warnings, differences, observed
from .deform_parameters import DeformParameters

if TYPE_CHECKING:
    from ..motion.field.observations import Data
    from ..motion.result import MotionFit
    from ..noise.shifted_part import MapShift


class Deform(DeformParameters):
    """Fit a similarity, strains and a smooth motion field, robustly. Lengths are in rms radii of the prior:
    26 mm for an atrium.
    """

    name: ClassVar[str] = "deform"

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        from ..motion.drift import fit_with_drift

        data = observed(case, self)
        if not (data.group == 0)[~data.inside].any():
            raise InputError(f"deform: case {case.name} has no points of type eam")
        fits = [self._fit_motion(case, start.T_map_prior, data)]
        if self.starts == "several" or (self.starts == "auto" and self.landmarks and _is_doubtful(fits[0])):
            fits += [self._fit_motion(case, pose, data) for pose in _landmark_poses(case)]
        best = min(fits, key=lambda fit: fit.energy)
        shift, pose = self._find_shift(best, start)
        taken_out = shift is not None and self.map_shift == "fit"
        if taken_out:
            case = replace(start, map_shift=shift).corrected(case)
            fits = [best := self._fit_motion(case, pose, observed(case, self))]
        independent = best
        if self.shared_errors == "find":
            best = allow_for_lost_order(case, fit_with_drift(best) or best)
        found = _describe_fit(case, best, len(best.problem.data.points))
        found = _with_shift(found, start, shift, taken_out=taken_out)
        warnings = [
            *point_warnings(best, len(best.problem.data.points), found.status, case.units),
            *shifted(shift, case, taken_out=taken_out),
            *motion_warnings(best, start.surface, found.surface, case.units),
            *another_heart(case, best),
            *order_lost(case, best),
            *self._single_start(case),
            *alternatives(independent, fits, case.units),
            *case_warnings(case, self.fits, start.T_map_prior, best.problem),
        ]
        return replace(found, warnings=(*start.warnings, *warnings))

    def update(self, case: Case, estimate: Estimate) -> Estimate:
        """Return an estimate of this stage after a few more points, in milliseconds: `case` has the points of
        before, and the new ones behind.

        Pose, amplitudes and noise levels stay; motion, posterior and outliers take in the new points. Within
        0.05 mm in the mean of a fit from nothing after one point, where that would leave the amplitudes as
        they are; a warning says when a tenth more points were added than these were estimated from. The
        column `sigma` compares new points with those of the estimate. Raises InputError where the estimate is
        not one of this stage, or prior, landmarks, parameters or the points of before have changed.
        """
        from ..motion.drift import with_doubt

        earlier, tuned_on = _own_fit(case, estimate)
        case = estimate.corrected(case)
        data = observed(case.visible(self.fits), self, earlier.problem.data)
        if self.settings() != earlier.problem.settings:
            raise InputError("update: the stage has other parameters than the one that made the estimate")
        if changed := differences(data, earlier.problem.data):
            raise InputError(f"update: {changed}")
        fit = self._fit_motion(case, estimate.T_map_prior, data, earlier)
        fit = with_doubt(fit, earlier.motion.doubt)
        found = replace(_describe_fit(case, fit, tuned_on), map_shift=estimate.map_shift)
        kept = (one for one in estimate.warnings if not self._judges_points(one))
        warnings = point_warnings(fit, tuned_on, found.status, case.units)
        return replace(found, warnings=(*kept, *of_stage(warnings, self.estimate_name)))

    def _fit_motion(self, case: Case, pose: Array, data: Data, earlier: MotionFit | None = None) -> MotionFit:
        from ..motion.fit import fit_motion

        return fit_motion(case.prior.vertices, case.prior.faces, pose, data, self.settings(), earlier)

    def _find_shift(self, fit: MotionFit, start: Estimate) -> tuple[MapShift | None, Array]:
        """Return the part of the map that is shifted, and the pose without it; no part if nobody asks or an
        earlier stage has taken it out.
        """
        from ..motion.map_shift.search import find_map_shift

        asked = self.map_shift != "ignore" and start.map_shift is None
        return (asked and find_map_shift(fit)) or (None, fit.problem.pose)

    def _single_start(self, case: Case) -> list[RunWarning]:
        """Return whether several starts are asked for and the landmarks give none."""
        if self.starts != "several" or _landmark_poses(case):
            return []
        sentence = (
            'starts = "several": no three landmark pairs determine a pose, so only the given start is used'
        )
        return [RunWarning("no-landmark-start", sentence)]

    def _judges_points(self, warning: RunWarning) -> bool:
        """Return whether a warning of this stage is about the points, and so is given anew by an update."""
        return warning.code in POINT_CODES and warning.stage in ("", self.estimate_name)


def _is_doubtful(fit: MotionFit) -> bool:
    """Say whether the points lie farther off the surface than contact with it leaves them."""
    return fit.sigma > fit.problem.settings.selection.doubtful_noise * fit.problem.size


def _landmark_poses(case: Case) -> list[Array]:
    """Return the poses (d+1, d+1) that the landmarks give, rigid and with a scale, if they determine one."""
    _, prior, measured = trusted_pairs(case)
    if not (determined(prior) and determined(measured)):
        return []
    return [fit_similarity(prior, measured, scale=scale) for scale in (False, True)]


def _describe_fit(case: Case, fit: MotionFit, tuned_on: int) -> Estimate:
    """Return the estimate of a fit. tuned_on: how many points amplitudes and noise were estimated from."""
    from ..motion.result import sentence

    fields = {**case.prior.fields, f"sd_{case.units}": fit.sd}
    return Estimate(
        surface=replace(case.prior, vertices=fit.vertices, fields=fields),
        T_map_prior=fit.similarity,
        status=sentence(fit, case.units, len(fit.problem.data.points) - tuned_on),
        converged=fit.converged,
        iterations=len(fit.trace),
        sigma=fit.sigma,
        weights=fit.weights,
        motion=fit.motion,
        trace=fit.trace,
        facts={**fit.facts, "tuned_on": tuned_on},
        fit=fit,
    )


def _with_shift(found: Estimate, start: Estimate, shift: MapShift | None, *, taken_out: bool) -> Estimate:
    """Return the estimate with what is known of a shifted part of the map."""
    if shift is None:
        return replace(found, map_shift=start.map_shift)
    facts = {**found.facts, "map_shift": shift.record() | {"taken_out": taken_out}}
    if not taken_out:
        return replace(found, facts=facts)
    status = f"{found.status}; an offset was taken out of {shift.points} of {shift.total} points"
    return replace(found, facts=facts, status=status, map_shift=shift)


def _own_fit(case: Case, estimate: Estimate) -> tuple[MotionFit, int]:
    """Return the fit of an estimate of this stage, and how many points its amplitudes were estimated from.
    Raises InputError where it is not one, or is one of another prior.
    """
    fit, tuned_on = estimate.fit, estimate.facts.get("tuned_on")
    if (
        fit is None
        or tuned_on is None
        or estimate.motion is not fit.motion
        or not _fits_prior(fit, case.prior)
    ):
        raise InputError(
            "update: the estimate must come from the stage 'deform' of this session, fitted to this prior"
        )
    return fit, int(tuned_on)


def _fits_prior(fit: MotionFit, prior: Surface) -> bool:
    problem = fit.problem
    return np.array_equal(problem.faces, prior.faces) and np.array_equal(problem.vertices, prior.vertices)
