"""Whether another pose of the prior, or one of its mirror image, fits the points clearly better, and whether
landmarks were measured where they belong.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from ..geometry.similarity import apply
from ..run_warning import RunWarning

if TYPE_CHECKING:
    from ..arrays import Array, Ints
    from ..case import Case
    from ..registration.global_pose import Candidate
    from ..registration.icp import Alignment
    from ..registration.match import SurfaceMatcher

    Align = Callable[[Array, Array], Alignment]

STARTS = 800  # rotations that a search tries
ENOUGH = 1000  # places that tell one pose from another: more take time and change no answer
SEED = 61_409
NEARLY = 1.1  # times the cost of the prior as named: a mirror image that costs more is not tried
MATERIAL = 0.01  # rms radii: poses whose points lie closer to the wall than this fit it alike
CERTAIN = 0.99  # confidence from which on a prior is refused as mirrored: a refusal must not be a mistake
QUESTIONED = 0.97  # ... and is asked about beside landmarks: right ones had .955 at most
# distance of a landmark from its own place over that from another's: 0.9 is the most among good ones, 2.6 the
# least of wrong ones
SWAPPED = 2.0


def asked_places(count: int) -> Ints:
    """Return the rows of so many places that a check of the pose asks: all, or some at random, each with the
    same chance. Those that lie farthest apart would be the extremes of the noise.
    """
    some = np.random.default_rng(SEED).permutation(count)[:ENOUGH]
    return np.sort(some)


def clearly_better(costs: Array, than: Array, points: Array, radius: float) -> bool:
    """Return whether one pose fits points (n, d) better than another by more than matters, and for certain,
    by the robust costs (n,) of both on a surface of this rms radius.
    """
    from ..registration.global_pose import confidence, robust_costs

    least = float(robust_costs(np.array([MATERIAL * radius]), radius)[0])
    return float((than - costs).mean()) >= least and confidence(costs, than, points) > CERTAIN


def better_mirrored(
    unit: str, points: Array, best: Candidate, other: Candidate, certain: float = CERTAIN
) -> str:
    """Return a sentence where the mirror image of the prior fits clearly better than the prior."""
    from ..registration.global_pose import confidence

    sure = confidence(other.costs, best.costs, points)
    if sure <= certain:
        return ""
    gaps = [float(np.median(c.alignment.pairs.distances)) for c in (best, other)]
    return (
        f"the points fit the mirror image of the prior (median distance {gaps[1]:.3g} {unit}) better than "
        f"the prior (median {gaps[0]:.3g} {unit}), confidence {sure:.2f}: flip one axis of the prior"
    )


def own_pose(
    points: Array, surface: SurfaceMatcher, found: Alignment, align: Align
) -> tuple[Array, Candidate]:
    """Return the points, of (n, d), that a check of the pose that ICP found asks, and that pose with their
    costs; `align` is the same ICP, to some points from a pose.
    """
    from ..errors import SolverError
    from ..registration.global_pose import Candidate, angle_of
    from ..registration.search import APART

    own = Candidate.of(found, surface.radius)
    rows = asked_places(len(points))
    if len(rows) == len(points):
        return points, own
    points = points[rows]
    with suppress(SolverError):
        # other poses are fitted to these points, so that this one has to be; where that leads away, it stays
        again = Candidate.of(align(points, own.T_map_prior), surface.radius)
        if angle_of(again.T_map_prior, own.T_map_prior) <= APART:
            return points, again
    return points, own.of_some(rows)


def better_pose(unit: str, points: Array, surface: SurfaceMatcher, own: Candidate, *, scale: bool) -> str:
    """Return a sentence where a search of all rotations finds a pose, or a mirror image, that fits points (n,
    d) clearly better than the pose that ICP found, both as of `own_pose`.
    """
    from ..registration.global_pose import angle_of, candidates, mirrored
    from ..registration.search import APART

    best = candidates(points, surface, starts=STARTS, scale=scale)[0]
    other_hand = candidates(points, mirrored(surface), starts=STARTS, scale=scale)[0]
    if better := better_mirrored(unit, points, best, other_hand):
        return better
    turned = angle_of(own.T_map_prior, best.T_map_prior)
    middle = surface.surface.vertices.mean(axis=0, keepdims=True)
    shift = float(np.linalg.norm(apply(own.T_map_prior, middle) - apply(best.T_map_prior, middle)))
    if turned <= APART and shift <= APART * surface.radius:  # one pose
        return ""
    if not clearly_better(best.costs, own.costs, points, surface.radius):
        return ""
    away = f"{np.degrees(turned):.0f} degrees" if turned > APART else f"{shift:.3g} {unit}"
    worse = f"ICP ended {away} from a pose that fits the points clearly better"
    return f"{worse}: check the frame of the start, begin with the stage global_pose, or give landmarks"


def mirrored_sides(case: Case, points: Array, surface: SurfaceMatcher) -> str:
    """Return a sentence where the points (n, d) fit the mirror image of the prior clearly better, with other
    names of its landmarks. The ostia of an atrium are nearly symmetrical: of a flipped prior whose veins are
    named by the side where they seem to be the landmarks fit, and its motion makes up for the rest.
    """
    from ..registration.global_pose import mirrored, refined, robust_costs
    from ..registration.landmarks import AS_GOOD, Reading, readings

    def cost(one: Reading) -> float:
        return float(robust_costs(surface.match(points, one.T_map_prior).distances, surface.radius).mean())

    names, prior, measured = case.landmark_pairs()
    points = points[asked_places(len(points))]
    named, *others = readings(prior, measured, np.ones(len(names)), scale=False)
    rivals = [one for one in others if one.mirrored and one.exchanged and one.rms <= AS_GOOD * named.rms]
    best = min(rivals, key=cost, default=None)
    if best is None or cost(best) > NEARLY * cost(named):
        return ""
    flip = np.diag([-1.0, *np.ones(prior.shape[1])])
    own = refined(points, surface, named.T_map_prior, scale=True)
    found = refined(points, mirrored(surface), best.T_map_prior @ flip, scale=True)
    better = own and found and better_mirrored(case.units, points, own, found, QUESTIONED)
    mixed = " and ".join(names[k] for k in best.exchanged)
    return f"{better}, and correct the names of its landmarks {mixed}, which fit both" if better else ""


def swapped_landmarks(case: Case, T_map_prior: Array) -> list[RunWarning]:
    """Warn of landmarks that lie far nearer to another's place on the posed prior than to their own."""
    names, prior, measured = case.landmark_pairs()
    if not names:
        return []
    apart = np.linalg.norm(measured[:, None] - apply(T_map_prior, prior)[None], axis=2)
    return [
        RunWarning(
            "landmark-swapped-place",
            f"landmark {names[k]} lies {apart[k, k]:.0f} {case.units} from its place on the prior and "
            f"{apart[k, other]:.0f} {case.units} from that of {names[other]}: was it measured there?",
        )
        for k, other in enumerate(apart.argmin(axis=1))
        if SWAPPED * apart[k, other] < apart[k, k]
    ]
