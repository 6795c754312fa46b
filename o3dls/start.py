"""Where a run begins: the rough pose that the case brings along, and whether points and prior can belong together at all."""

from __future__ import annotations

import numpy as np

from .case import Case
from .errors import InputError
from .estimate import Estimate
from .evaluate import distances, landmark_errors
from .geometry import Array, fit_similarity
from .registration.landmarks import determined

FEWEST_POINTS = 10
SPANS = (0.1, 4.0)  # extent of the points relative to the prior's: a single vein is 0.15, a chamber 1
FARTHEST = 0.5  # median distance of the points from the prior after the start pose, relative to its diagonal


def start_estimate(case: Case) -> Estimate:
    """The prior in its rough pose: rigid fit of the named landmarks, else `init`, else as it stands; the status says which."""
    names, prior, measured = case.landmark_pairs()
    if _fixed_by(prior, measured):
        start = _placed(case, fit_similarity(prior, measured, scale=False), "")
        error = np.sqrt((landmark_errors(case, start) ** 2).mean())
        return _placed(case, start.T_map_prior, f"rigid fit of {len(names)} landmarks ({', '.join(names)}), rms {error:.2f} {case.units}")
    why = f"; {len(names)} landmark pairs on one line fix no pose" if len(names) >= 3 else ""
    if case.init is not None:
        return _placed(case, case.init, f"pose from the case's init matrix{why}")
    return _placed(case, np.eye(case.dimension + 1), f"identity: the case has neither 3 landmark pairs nor an init matrix{why}")


def check_start(case: Case, start: Estimate, *, pose_is_known: bool) -> None:
    """Raise InputError unless there are enough points, as large as the prior and, where the pose counts as known, near it."""
    points = case.points.of("eam").xyz
    if len(points) < FEWEST_POINTS:
        raise InputError(f"case {case.name}: {len(points)} points of type eam; at least {FEWEST_POINTS} are needed")
    _check_span(case, float(np.linalg.norm(np.ptp(points, axis=0))))
    if pose_is_known:
        _check_near(case, start, float(np.median(distances(points, start.surface))))


def doubts(case: Case, start: Estimate) -> list[str]:
    """A sentence where no landmarks fix the start pose and the points fit the prior clearly better in one that lies elsewhere: an `init`
    of another frame leads to a surface that looks right, since a motion can mend what a turned chamber lacks.
    """
    _, prior, measured = case.landmark_pairs()
    if _fixed_by(prior, measured):
        return []
    from .registration.match import SurfaceMatcher
    from .stages.global_pose import beaten
    from .stages.icp import ICP, fitted_points

    icp, points, surface = ICP(), fitted_points(case), SurfaceMatcher(case.prior)
    said = beaten(case.units, points, surface, icp.aligned(points, surface, start.T_map_prior), scale=icp.scale)
    return [f"the start may be wrong: {said}"] if said else []


def _fixed_by(prior: Array, measured: Array) -> bool:
    """Whether landmark pairs (k, d) fix a pose."""
    return len(prior) >= 3 and determined(prior) and determined(measured)


def _placed(case: Case, T_map_prior: Array, status: str) -> Estimate:
    return Estimate(case.prior.transformed(T_map_prior), T_map_prior, status)


def _check_span(case: Case, span: float) -> None:
    """Points in another unit than the prior's are many times too small, not a little."""
    ratio = span / case.prior.diagonal
    if SPANS[0] <= ratio <= SPANS[1]:
        return
    units = {"m": 1e3, "in": 25.4, "cm": 10.0}  # either side's may have been taken for mm
    likely = min(units, key=lambda unit: abs(np.log(units[unit]) - abs(np.log(max(ratio, 1e-300)))))
    points = f"if the points are in {likely}, put the line '# units={likely}' above the header of their file"
    prior = f"if the prior is in {likely}, write it in mm: o3dls convert PRIOR OUT --units {likely}"
    raise InputError(
        f"case {case.name}: the points span {span:.3g} {case.units}, the prior {case.prior.diagonal:.3g} {case.units}: "
        f"{points if ratio < 1.0 else prior}; if not, look for the wrong unit on the other side"
    )


def _check_near(case: Case, start: Estimate, gap: float) -> None:
    if gap <= FARTHEST * case.prior.diagonal:
        return
    raise InputError(
        f"case {case.name}: half of the points are more than {gap:.3g} {case.units} away from the prior ({case.prior.diagonal:.3g} "
        f"{case.units} across) after the start ({start.status}): give 3 or more named landmarks or an init matrix, check the frame, "
        "or begin the pipeline with the stage global_pose"
    )
