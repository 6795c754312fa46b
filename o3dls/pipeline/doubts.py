"""Cases whose parts are each in order and cannot be meant together: refused where that is certain, else a
warning.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..case import Case
from ..estimate import Estimate
from ..geometry.similarity import TURN, apply, fit_similarity, rms_radius
from ..geometry.surface import Surface
from ..registration.landmarks import explaining_scale, fix_a_pose
from ..run_warning import RunWarning
from ..stages.landmarks import ANOTHER_SIZE

THINNEST = 0.05  # thickness of the points over their width: one wall of an atrium has .15
FACTORS = {"cm": 10.0, "in": 25.4, "m": 1000.0}  # units that one column may be in, in mm
FAR_LANDMARKS = 0.2  # rms error of landmarks over their rms radius, above which their columns are looked at
BETTER = 3.0  # how many times smaller the error must become: only mapping error remains then
OVERLAP = 0.1  # of the volume that components enclose twice, above which they are one within another
SIZES = (0.6, 1.65)  # of the map over the prior: hearts of two persons, or of one in time, differ by less
LATTICE = 60  # nodes along the diagonal, on which that is counted
ROUND = 0.5  # distance of the points from a sphere over that from the prior
NEAR = 0.05  # rms radii: points nearer to the prior than that lie on it
ONE_SIDE = 0.9  # share of the points that lie on one side of the prior; warned of only
OFFSET = 0.15  # at this median distance, in rms radii: 4 mm for an atrium
NOISY = 0.085  # noise in rms radii: 2.2 mm for an atrium; mapping has 1 to 2 mm
NOISY_POSE = 0.11  # the same for a pose, 2.9 mm: it leaves residuals that only a motion can follow
CALM = 0.025  # noise in rms radii, 0.65 to 0.8 mm for atria: no catheter has less
SPREAD = 200  # number of points, spread evenly, that are used: many beats at one place count once


def contradiction(case: Case, start: Estimate) -> str:
    """Return why prior, points and landmarks cannot belong together; empty where they can."""
    if case.dimension == 2:
        return ""
    points = case.points.of("eam").xyz
    return (
        _find_overlap(case)
        or _find_scale(case)
        or _find_wrong_column(case)
        or _find_plane(case, points)
        or _find_mixed_frames(case, start, points)
    )


def doubtful_points(case: Case, start: Estimate, final: Estimate) -> list[RunWarning]:
    """Return warnings where the points are not what a catheter finds on the wall of this prior."""
    from ..registration.search import thinned

    if case.dimension == 2:
        return []
    points = thinned(case.points.of("eam").xyz, SPREAD)
    found = []
    if ball := _find_ball(points, case.prior.transformed(final.T_map_prior)):
        found.append(RunWarning("points-on-a-ball", ball))
    if beside := _find_one_side(case, start, points):
        found.append(RunWarning("points-beside-the-wall", beside))
    if scattered := _find_scatter(case, final):
        found.append(RunWarning("large-noise", scattered))
    if calm := _find_calm(case, final):
        found.append(RunWarning("small-noise", calm))
    return found


def _find_overlap(case: Case) -> str:
    """Return a sentence where components of the prior lie in one another, as two surfaces in one file do."""
    from ..geometry.components import component_areas
    from ..levelset.grid.distance import filled_distance

    prior = case.prior
    if not prior.watertight or len(component_areas(prior)[1]) < 2:
        return ""
    spacing = prior.diagonal / LATTICE
    inside = int((filled_distance(prior.vertices, prior.faces, spacing, 1).phi < 0.0).sum()) * spacing**3
    if prior.volume <= (1.0 + OVERLAP) * inside:
        return ""
    return (
        f"the prior's components overlap: together they enclose {prior.volume / 1000:.3g} ml, and their "
        f"union {inside / 1000:.3g} ml; give one closed surface of the chamber"
    )


def _find_scale(case: Case) -> str:
    """Return a sentence where the landmarks show that prior and points differ by one factor of scale."""
    _, prior, measured = case.landmark_pairs()
    if not fix_a_pose(prior, measured):
        return ""
    factor = explaining_scale(prior, measured)
    return "" if SIZES[0] <= factor <= SIZES[1] else ANOTHER_SIZE.format(1.0 / factor)


def _find_plane(case: Case, points: Array) -> str:
    deviations = np.sqrt(np.clip(np.linalg.eigvalsh(np.cov(points.T)), 0.0, None))
    if deviations[0] > THINNEST * deviations[1]:
        return ""
    return (
        f"the points of type eam lie in one plane ({2.0 * deviations[0]:.2g} {case.units} thick and "
        f"{2.0 * deviations[1]:.2g} wide): a chamber needs points on several of its walls"
    )


def _find_wrong_column(case: Case) -> str:
    """Return a sentence where the landmarks show one column of coordinates to be in another unit than the
    others.
    """
    names, prior, measured = case.landmark_pairs()
    if len(names) < 4 or not fix_a_pose(prior, measured):
        return ""
    before = _landmark_error(prior, measured)
    if before < FAR_LANDMARKS * float(np.sqrt(prior.var(axis=0).sum())):
        return ""
    tried = [
        (_landmark_error(prior, measured * np.where(np.arange(3) == axis, times, 1.0)), column, unit, times)
        for axis, column in enumerate("xyz")
        for unit, factor in FACTORS.items()
        for times in (factor, 1.0 / factor)
    ]
    after, column, unit, times = min(tried)
    if after * BETTER >= before:
        return ""
    said = unit if times > 1.0 else f"mm where the others are in {unit}"
    return (
        f"the column {column} of the points seems to be in {said}: the landmarks fit to {after:.2g} "
        f"{case.units} then, and to {before:.2g} as it is"
    )


def _landmark_error(prior: Array, measured: Array) -> float:
    """Return the root mean square distance of landmarks after their best rigid motion."""
    gap = apply(fit_similarity(prior, measured, scale=False), prior) - measured
    return float(np.sqrt((gap**2).sum(axis=1).mean()))


def _find_mixed_frames(case: Case, start: Estimate, points: Array) -> str:
    """Return a sentence where points are in LPS beside landmarks in RAS, or the other way round: turned, they
    fit clearly better. The same for the prior and its landmarks, which must then lie nearer to it as well:
    names of left and right that are exchanged turn the pose about as much.
    """
    from ..geometry.closest_point import ClosestPoint

    _, prior, measured = case.landmark_pairs()
    if not fix_a_pose(prior, measured):
        return ""
    turned = _find_turned(case, start, points)
    if turned == "points":
        return (
            "the points fit the prior clearly better where x and y have the other sign, and the landmarks do "
            "not: are the ones in LPS and the others in RAS? Bring all rows of points.csv into one frame"
        )
    off = ClosestPoint(case.prior.vertices, case.prior.faces)
    nearer = off.query(apply(TURN, prior))[0].mean() < off.query(prior)[0].mean()
    if turned != "prior" or not nearer:
        return ""
    return (
        "the prior fits the points clearly better where its x and y have the other sign, and its landmarks "
        "lie nearer to it then: is one of them in LPS and the other in RAS? Bring the prior and "
        "prior_landmarks.csv into one frame"
    )


def other_frame(case: Case, start: Estimate) -> str:
    """Return a sentence where the start would be right for points, or a prior, of the other frame."""
    if case.dimension == 2 or not (turned := _find_turned(case, start, case.points.of("eam").xyz)):
        return ""
    return (
        f"the points fit the prior clearly better where x and y of the {turned} have the other sign: are the "
        f"{turned} in RAS and the rest of the case in LPS, or the other way round? Bring all into one frame"
    )


def _find_turned(case: Case, start: Estimate, points: Array) -> str:
    """Return what fits clearly better in the other frame at the start, `points` or `prior`; empty where
    neither does. Many beats of one contact count once.
    """
    from ..noise.duplicates import wall_places
    from ..registration.global_pose import robust_costs
    from ..registration.match import SurfaceMatcher
    from ..stages.pose_checks import clearly_better

    points = points[wall_places(points, rms_radius(case.prior.vertices))[0]]
    surface = SurfaceMatcher(case.prior)

    def costs(xyz: Array, T_map_prior: Array) -> Array:
        return robust_costs(surface.match(xyz, T_map_prior).distances, surface.radius)

    T = start.T_map_prior
    given = costs(points, T)
    tried = {"points": costs(apply(TURN, points), T), "prior": costs(points, T @ TURN)}
    best = min(tried, key=lambda turned: float(tried[turned].mean()))
    return best if clearly_better(tried[best], given, points, surface.radius) else ""


def _find_ball(points: Array, prior: Surface) -> str:
    """Return a sentence where the points lie much nearer to a ball than to the prior in its pose."""
    from ..evaluation.distances import distances

    design = np.column_stack([2.0 * points, np.ones(len(points))])
    found = np.linalg.lstsq(design, (points**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(found[3] + (found[:3] ** 2).sum(), 0.0)))
    off = float(np.median(np.abs(np.linalg.norm(points - found[:3], axis=1) - radius)))
    gap = float(np.median(distances(points, prior)))
    if off >= ROUND * gap or gap < NEAR * rms_radius(prior.vertices):
        return ""
    return (
        f"the points lie on a ball of radius {radius:.3g} (median distance {off:.2g}) rather than on the "
        f"prior in its pose (median {gap:.2g}): are they of this chamber?"
    )


def _find_one_side(case: Case, start: Estimate, points: Array) -> str:
    """Return a sentence where nearly all points lie on one side of the prior in the pose of the landmarks."""
    from ..registration.match import SurfaceMatcher

    _, prior, measured = case.landmark_pairs()
    if not fix_a_pose(prior, measured):
        return ""
    surface = SurfaceMatcher(case.prior)
    signed = surface.match(points, start.T_map_prior).signed
    middle = float(np.median(signed))
    share = float((np.sign(signed) == np.sign(middle)).mean())
    if share < ONE_SIDE or abs(middle) < OFFSET * surface.radius:
        return ""
    side, change = ("outside", "grown") if middle > 0.0 else ("inside", "shrunk")
    return (
        f"{share:.0%} of the points lie {side} the prior where the landmarks put it, by {abs(middle):.2g} "
        f"{case.units} in the median: has the chamber {change} so much, or do the points lie beside its wall?"
    )


def _find_scatter(case: Case, final: Estimate) -> str:
    """Return a sentence where the points scatter about the result more than mapping does, by the noise that a
    stage found, else by all distances: points spread evenly over a dense map are the extremes of its noise.
    """
    from ..evaluation.distances import distances
    from ..noise.robust import robust_sd

    points = case.points.of("eam").xyz
    scatter = robust_sd(distances(points, final.surface)) if final.sigma is None else final.sigma
    most = NOISY_POSE if final.motion is None else NOISY
    if scatter < most * rms_radius(case.prior.vertices):
        return ""
    return (
        f"the points scatter by {scatter:.2g} {case.units} about the result, more than mapping does (1 to 2 "
        "mm): many may not touch the wall, or prior and points may not belong together"
    )


def _find_calm(case: Case, final: Estimate) -> str:
    """Return a sentence where a motion leaves the points less noise than a catheter has, none in common."""
    least = CALM * rms_radius(case.prior.vertices)
    known = final.motion is None or any(one.code == "errors-together" for one in final.warnings)
    if known or not final.sigma or final.sigma >= least:
        return ""
    return (
        f"the noise found is {final.sigma:.3g} {case.units}, less than a catheter has ({least:.3g}): "
        "points that were projected to a shell, or sorted, hide their errors in the wall"
    )
