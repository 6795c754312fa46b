"""Points that a fit has not seen: how far they lie from its surface, and how far it expected them to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Mask
from ..estimate import Estimate
from .projection import project


@dataclass(frozen=True, eq=False)
class LeftOut:
    """This holds the distance (n,) of each point from the surface of a fit without it, and the standard
    deviation (n,) that this fit predicts of that distance, by its posterior and its noise; NaN where it
    predicts none.
    """

    distance: Array
    deviation: Array

    @classmethod
    def unknown(cls, count: int) -> LeftOut:
        """Return that of so many points of which nothing is known yet."""
        return cls(np.full(count, np.nan), np.full(count, np.nan))

    def fill(self, rows: Mask, other: LeftOut) -> None:
        """Take over what is known of some of the points."""
        self.distance[rows], self.deviation[rows] = other.distance, other.deviation


def left_out_points(xyz: Array, estimate: Estimate, unit: str) -> LeftOut:
    """Return how points (n, d), which an estimate has not seen, lie to its surface."""
    wall = project(xyz, estimate.surface)
    sd = estimate.surface.fields.get(f"sd_{unit}")
    if sd is None or estimate.sigma is None:
        return LeftOut(wall.distance, np.full(len(xyz), np.nan))
    there = np.einsum("nc,nc->n", wall.weights, sd[estimate.surface.faces[wall.face]])
    return LeftOut(wall.distance, np.hypot(there, estimate.sigma))
