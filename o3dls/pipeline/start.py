"""Where a run begins: the rough pose of the case, and whether points and prior can belong together."""

from __future__ import annotations

import logging
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..case import FITTED_TYPES, Case
from ..errors import SolverError
from ..estimate import Estimate
from ..evaluation.trusted_landmarks import trusted_pairs
from ..geometry.shells import wall_thickness
from ..geometry.similarity import fit_similarity
from ..io.surfaces import A_WALL
from ..registration.landmark_names import alone
from ..registration.landmarks import errors, fix_a_pose
from ..run_warning import RunWarning
from .doubts import contradiction, other_frame

log = logging.getLogger("o3dls")
FEWEST_POINTS = 10
SPANS = (0.1, 4.0)  # extent of the points relative to the prior's: a single vein is 0.15, a chamber 1
MOST = (0.05, 0.95)  # quantiles between which points must not be too wide, whatever outliers there are
# quantiles between which they must not be too narrow, however densely one place was mapped
NEARLY_ALL = (0.01, 0.99)
UNITS = {"m": 1e3, "in": 25.4, "cm": 10.0, "um": 1e-3}  # in mm: what may have been mistaken for it
ATRIUM = 100.0  # mm across: points and prior are about as large once their units are right
POINTS_IN = "if the points are in {0}, add the line '# units={0}' above the header of their file"
PRIOR_IN = "if the prior is in {0}, write it in mm: o3dls convert PRIOR OUT --units {0}"
IN_MEMORY = "if the {2} are in {0}, multiply them by {1:g}"  # of a case that has no files
FLATTEST = 1e-3  # mean thickness relative to the diagonal: .15 is an atrium
FARTHEST = 0.5  # median distance of the points from the prior after the start pose, relative to its diagonal


def start_estimate(case: Case) -> Estimate:
    """Return the prior in its rough pose: rigid fit of the named landmarks, else `init`, else as it stands;
    the status says which.
    """
    names, prior, measured = trusted_pairs(case)
    if fix_a_pose(prior, measured):
        T_map_prior = fit_similarity(prior, measured, scale=False)
        error = np.sqrt((errors(prior, measured, T_map_prior) ** 2).mean())
        return _place_prior(
            case,
            T_map_prior,
            f"rigid fit of {len(names)} landmarks ({', '.join(names)}), rms {error:.2f} {case.units}",
        )
    why = f"; {len(names)} landmark pairs on one line do not determine a pose" if len(names) >= 3 else ""
    if case.init is not None:
        return _place_prior(case, case.init, f"pose from the case's init matrix{why}")
    return _place_prior(
        case,
        np.eye(case.dimension + 1),
        f"prior as given: the case has neither 3 landmark pairs nor an init matrix{why}",
    )


def say_unpaired(case: Case) -> None:
    """Log the landmarks of either side that have no pair, since they are not used."""
    names = case.points.columns.get("name", np.full(len(case.points), ""))
    ours = [str(name) for name in names[case.points.type == "landmark"]]
    theirs = list(case.prior_landmarks)
    for side, some, others in (("points", ours, theirs), ("prior", theirs, ours)):
        for name in alone(some, others):
            said = "landmark %s of the %s is not used: it has no pair on the other side, which has %s"
            log.info(said, name, side, ", ".join(others) or "none")


def misfit(case: Case, start: Estimate, *, pose_is_known: bool) -> list[str]:
    """Return a sentence where the prior encloses nothing, or the points are too few, of another size than the
    prior or, where the pose counts as known, far from it.
    """
    points = case.points.of("eam").xyz
    found = (
        _find_flat_prior(case)
        or _find_few_places(points)
        or _find_other_size(case, points)
        or _find_far_point(case, points)
        or contradiction(case, start)
    )
    if not found and pose_is_known:
        found = _find_far_start(case, start, points)
    return [found] if found else []


def pose_unknown(case: Case) -> bool:
    """Return whether the pose of the prior has to be searched: neither landmarks nor `init` give it, and
    another pose fits the points clearly better than the one that ICP finds from the prior as it is given.
    """
    start = start_estimate(case)
    if _gives_pose(case):
        return False
    if misfit(case, start, pose_is_known=False):
        return False  # no pose helps, and the run is refused with the reason
    if _find_far_start(case, start, case.points.of("eam").xyz):
        return True
    try:
        return bool(_better_pose(case, start))
    except SolverError:  # ICP finds nothing near the prior
        return True


def start_digest(case: Case) -> str:
    """Return a digest of what `pose_unknown` judges, prior and points: who has its answer need not ask for
    the pose again. Empty where the case gives the pose, about which it says nothing.
    """
    if _gives_pose(case):
        return ""
    parts = (case.prior.vertices, case.prior.faces, case.points.of("eam").xyz)
    return sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


def _gives_pose(case: Case) -> bool:
    return case.init is not None or fix_a_pose(*case.landmark_pairs()[1:])


def doubtful_pose(case: Case, start: Estimate, sound: str = "") -> list[RunWarning]:
    """Return a warning where the points fit the prior clearly better in another pose than landmarks or `init`
    give: one of another frame leads to a surface that looks right, since a motion can make up for a turned
    chamber. sound: `start_digest` of a case about whose pose there was nothing to say.
    """
    if sound and sound == start_digest(case):
        return []
    if not (better := _better_pose(case, start)):
        return []
    other = "" if fix_a_pose(*case.landmark_pairs()[1:]) else other_frame(case, start)
    why = "; ".join(filter(None, (better, other)))
    return [RunWarning("start-pose-doubtful", f"the start may be wrong: {why}")]


def _better_pose(case: Case, start: Estimate) -> str:
    """Return a sentence where the points fit the prior, or its mirror image, clearly better in another pose
    than in the one that ICP finds from the start; beside landmarks only the mirror image is tried.
    """
    from ..registration.match import SurfaceMatcher
    from ..stages.icp import ICP, fitted_places
    from ..stages.pose_checks import better_pose, mirrored_sides, own_pose

    icp = ICP()
    points, _ = fitted_places(case)
    surface = SurfaceMatcher(case.prior)
    if fix_a_pose(*case.landmark_pairs()[1:]):
        return mirrored_sides(case, points, surface)
    found = icp.aligned(points, surface, start.T_map_prior)
    some, own = own_pose(points, surface, found, lambda xyz, T: icp.aligned(xyz, surface, T))
    return better_pose(case.units, some, surface, own, scale=icp.scale)


def components_without_points(case: Case, T_map_prior: Array) -> list[RunWarning]:
    """Return a warning for each component of the prior, but for small ones, that is nearest to no point:
    nothing tells where it lies.
    """
    from ..geometry.closest_point import ClosestPoint
    from ..geometry.components import SMALL_COMPONENT, component_areas

    prior = case.prior
    points = case.points.of(*FITTED_TYPES).xyz
    component, areas = component_areas(prior)
    nearest = ClosestPoint(prior.transformed(T_map_prior).vertices, prior.faces).query(points)[1]
    unseen = np.setdiff1d(np.flatnonzero(areas >= SMALL_COMPONENT * areas.max()), component[nearest])
    return [
        RunWarning(
            "component-without-points",
            f"no point is near the component of the prior {_describe_place(case, component == k)} "
            f"({areas[k] / prior.area:.0%} of its area): does it belong to this chamber?",
        )
        for k in unseen
    ]


def _describe_place(case: Case, faces: NDArray[np.bool_]) -> str:
    """Return where some faces of the prior lie."""
    middle = case.prior.vertices[np.unique(case.prior.faces[faces])].mean(axis=0)
    return f"around ({', '.join(f'{x:.0f}' for x in middle)}) {case.units}"


def _place_prior(case: Case, T_map_prior: Array, status: str) -> Estimate:
    return Estimate(case.prior.transformed(T_map_prior), T_map_prior, status)


def _find_flat_prior(case: Case) -> str:
    prior, unit = case.prior, case.units
    if not prior.watertight or prior.dimension * prior.volume > FLATTEST * prior.diagonal * prior.area:
        return f"the prior {A_WALL.format(thickness)}" if (thickness := wall_thickness(prior)) else ""
    return (
        f"the prior is flat: it is {prior.diagonal:.3g} {unit} across and encloses nothing; give the closed "
        "surface of a chamber"
    )


def _find_few_places(points: Array) -> str:
    places = len(np.unique(points, axis=0))
    return (
        ""
        if places >= FEWEST_POINTS
        else f"the points of type eam have {places} different positions: at least {FEWEST_POINTS} are needed"
    )


def _find_other_size(case: Case, points: Array) -> str:
    """Return a sentence where the points are of another size than the prior: in another unit they are many
    times too small or too large, not a little.
    """
    most, span = (
        max(float(np.linalg.norm(np.ptp(np.quantile(points, part, axis=0), axis=0))), 1e-300)
        for part in (MOST, NEARLY_ALL)
    )
    size = case.prior.diagonal
    unit = case.units
    if SPANS[0] <= span / size and most / size <= SPANS[1]:
        return ""
    span = most if most / size > SPANS[1] else span
    spans = f"the points span {span:.3g} {unit}, the prior {size:.3g} {unit}"
    readings = [(span * mm, size, POINTS_IN, name) for name, mm in UNITS.items()]
    readings += [(span, size * mm, PRIOR_IN, name) for name, mm in UNITS.items()]
    likely = [reading for reading in readings if SPANS[0] <= reading[0] / reading[1] <= SPANS[1]]
    if unit == "px" or not likely:
        return (
            f"{spans}, and no unit explains that: do nearly all points lie in one place, or do they belong "
            "to another case?"
        )
    *_, remedy, name = min(likely, key=lambda reading: float(np.ptp(np.log((*reading[:2], ATRIUM)))))
    if not case.files:
        whose = "points" if remedy is POINTS_IN else "vertices of the prior"
        return f"{spans}: {IN_MEMORY.format(name, UNITS[name], whose)}; otherwise check the units of both"
    return f"{spans}: {remedy.format(name)}; otherwise check the units of both"


def _find_far_point(case: Case, points: Array) -> str:
    """Return a sentence on the farthest point, where it is too far off to be of this map."""
    away = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    far = int(away.argmax())
    if away[far] <= SPANS[1] * case.prior.diagonal:
        return ""
    row = np.flatnonzero(case.points.type == "eam")[far]
    return (
        f"the point in row {row} (counted from 0) lies {away[far]:.3g} {case.units} from the middle of all "
        "points: correct it or remove it"
    )


def _find_far_start(case: Case, start: Estimate, points: Array) -> str:
    from scipy.spatial import cKDTree

    # vertices stand for the wall here, which needs no compiled loops
    gap = float(np.median(cKDTree(start.surface.vertices).query(points)[0]))
    size = case.prior.diagonal
    unit = case.units
    if gap <= FARTHEST * size:
        return ""
    away = f"half of the points are more than {gap:.3g} {unit} away from the prior ({size:.3g} {unit} across)"
    remedy = other_frame(case, start) or (
        "to fix this, give 3 or more named landmarks or an init matrix, check the frame, or begin the "
        "pipeline with the stage global_pose"
    )
    return f"{away} after the start ({start.status}): {remedy}"
