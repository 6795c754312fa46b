"""Where points meet a surface: the closest place of each on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Ints
from ..geometry.surface import Surface


@dataclass(frozen=True, eq=False)
class Projection:
    """A projection says where points (k, d) meet a surface.

    Distance (k,), face (k,), foot (k, d) and barycentric weights (k, d) in it.
    """

    distance: Array
    face: Ints
    foot: Array
    weights: Array


def project(xyz: Array, surface: Surface) -> Projection:
    """Return the closest points of a surface to points (k, d)."""
    squared, face, foot, weights = surface.closest_point.query(np.asarray(xyz, dtype=np.float64))
    return Projection(np.sqrt(squared), face, foot, weights)
