"""Whether a pose of the prior is clearly beaten by another one, or by that of its mirror image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..arrays import Array
    from ..registration.global_pose import Candidate
    from ..registration.icp import Alignment
    from ..registration.match import SurfaceMatcher

STARTS = 800  # rotations that a search tries
CERTAIN = 0.99  # confidence from which on a prior is refused as mirrored: a refusal must not be a mistake


def fits_mirrored(unit: str, points: Array, best: Candidate, other: Candidate) -> str:
    from ..registration.global_pose import confidence

    sure = confidence(other.costs, best.costs, points)
    if sure <= CERTAIN:
        return ""
    gaps = [float(np.median(c.alignment.pairs.distances)) for c in (best, other)]
    return (
        f"the points fit the mirror image of the prior (median distance {gaps[1]:.3g} {unit}) better than "
        f"the prior (median {gaps[0]:.3g} {unit}), confidence {sure:.2f}: flip one axis of the prior"
    )


def beaten(unit: str, points: Array, surface: SurfaceMatcher, found: Alignment, *, scale: bool) -> str:
    """What is wrong with the pose that icp found, where a search of all rotations finds one, or a mirror
    image, that fits points (n, d) clearly better; else nothing.
    """
    from ..registration.global_pose import Candidate, angle_of, candidates, confidence, mirrored
    from ..registration.search import APART

    own = Candidate.of(found, surface.radius)
    best = candidates(points, surface, starts=STARTS, scale=scale)[0]
    if said := fits_mirrored(
        unit, points, best, candidates(points, mirrored(surface), starts=STARTS, scale=scale)[0]
    ):
        return said
    away = angle_of(own.T_map_prior, best.T_map_prior)
    if away <= APART or confidence(best.costs, own.costs, points) <= CERTAIN:
        return ""
    turned = f"icp ended {np.degrees(away):.0f} degrees from a pose that fits the points clearly better"
    return f"{turned}: check the frame of the start, begin with the stage global_pose, or give landmarks"
