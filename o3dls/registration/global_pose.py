"""The pose of points on a surface with no start at all, how sure it is, and whether the surface is the wrong
hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erf

import numpy as np

from ..arrays import Array, Ints
from ..errors import SolverError
from ..geometry.similarity import scale_of
from .icp import Alignment, Criteria, Recipe, align, wall_or_cavity
from .lattice import signed_lattice
from .match import SurfaceMatcher
from .metrics import point_to_plane
from .search import APART, WIDTHS, Poses, search, thinned
from .step import Freedom

BLOCKS = 25  # neighbouring points err alike, so blocks of them are compared, not single points


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate is a refined pose with the robust cost (n,) in [0, 1] of every point."""

    alignment: Alignment
    costs: Array

    @classmethod
    def of(cls, alignment: Alignment, radius: float) -> Candidate:
        return cls(alignment, robust_costs(alignment.pairs.distances, radius))

    @property
    def T_map_prior(self) -> Array:
        return self.alignment.T_map_prior

    def of_some(self, rows: Ints) -> Candidate:
        """Return this pose with the costs of some points."""
        return Candidate(self.alignment, self.costs[rows])


def candidates(points: Array, surface: SurfaceMatcher, *, starts: int, scale: bool) -> list[Candidate]:
    """Return the poses of the surface for points (n, d), best first, refined on the exact surface, no two of
    like rotation.
    """
    middle = surface.surface.vertices.mean(axis=0)
    found = search(points, signed_lattice(surface.surface), middle, surface.radius, starts)
    refined = [_refine_pose(points, surface, found, row, scale=scale) for row in range(len(found.costs))]
    ranked = sorted(
        (c for c in refined if c is not None), key=lambda candidate: float(candidate.costs.mean())
    )
    apart: list[Candidate] = []
    for candidate in ranked:
        if all(angle_of(candidate.T_map_prior, other.T_map_prior) > APART for other in apart):
            apart.append(candidate)
    if not apart:
        raise SolverError(
            "global_pose: none of the poses found could be refined; the points do not fit this surface "
            "anywhere"
        )
    return apart


def _refine_pose(
    points: Array, surface: SurfaceMatcher, found: Poses, row: int, *, scale: bool
) -> Candidate | None:
    """Refine a pose that a search found; return None where ICP cannot go on from it."""
    return refined(points, surface, found.T_map_prior(row, scale=scale), scale=scale)


def refined(points: Array, surface: SurfaceMatcher, T_map_prior: Array, *, scale: bool) -> Candidate | None:
    """Refine a pose (d+1, d+1) by ICP; return None where ICP cannot go on from it."""
    try:
        freedom = Freedom(scale, 0.1, (0.5, 2.0))
        recipe = Recipe(point_to_plane, freedom, belief=wall_or_cavity(surface.radius))
        criteria = Criteria(tolerance=1e-3 * surface.radius, iterations=40)
        alignment = align(points, surface, T_map_prior, recipe, criteria)
    except SolverError:
        return None
    return Candidate.of(alignment, surface.radius)


def robust_costs(distances: Array, radius: float) -> Array:
    """Return Geman-McClure costs (n,) in [0, 1] of distances (n,) from a surface of this rms radius."""
    ratio = (distances / (WIDTHS[1] * radius)) ** 2
    return np.asarray(ratio / (1.0 + ratio))


def angle_of(a: Array, b: Array) -> float:
    """Return the angle in radians between the rotations of two similarity matrices (d+1, d+1)."""
    turn = (a[:-1, :-1] / scale_of(a)).T @ (b[:-1, :-1] / scale_of(b))
    if len(turn) == 2:
        return float(abs(np.arctan2(turn[1, 0], turn[0, 0])))
    return float(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))


def confidence(best: Array, other: Array, points: Array) -> float:
    """Return the probability that a pose of costs `best` (n,) is better than one of costs `other` for new
    points like these: a paired test between blocks of neighbours, 0.5 where nothing tells them apart.
    """
    centres = thinned(points, BLOCKS)
    block = ((points[:, None] - centres[None]) ** 2).sum(axis=2).argmin(axis=1)
    gain = other - best
    sums = np.bincount(block, weights=gain - gain.mean(), minlength=len(centres))
    error = float(np.sqrt((sums**2).sum())) / len(gain)
    return 0.5 * (1.0 + erf(float(gain.mean()) / max(error, 1e-12) / np.sqrt(2.0)))


def mirrored(surface: SurfaceMatcher) -> SurfaceMatcher:
    """Return the mirror image of a surface (first axis turned round), wound outward."""
    flip = np.eye(surface.surface.dimension + 1)
    flip[0, 0] = -1.0
    return SurfaceMatcher(surface.surface.transformed(flip))
