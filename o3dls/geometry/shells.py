"""Surfaces that enclose a wall in place of a chamber: both of its sides, the inner and the outer one."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from .surface import Surface

# mean thickness, 3 V / (A diagonal): of 60 atria at least .089, of walls of 2 to 5 mm .03 to .07
THIN = 0.08
WALL = 0.06  # width of the balls inside, over the diagonal: of atria at least .086, of walls .02 to .05
MOST = 0.9  # share of the places whose balls are not wider
PLACES, OTHERS = 400, 60_000  # places where balls touch, and vertices that they must not hold
SEED = 70_312


@np.errstate(over="ignore", invalid="ignore")  # a damaged file may hold any number
def wall_thickness(surface: Surface) -> float:
    """Return the thickness of a closed surface in 3D that is a wall, from its inner to its outer side; 0 of
    one that encloses a chamber.
    """
    if surface.dimension != 3 or not surface.watertight or not _mean_thickness(surface) < THIN:
        return 0.0
    from .inner_balls import inner_balls  # here, because it brings scipy

    share = surface.vertex_areas / surface.area
    draw = np.random.default_rng(SEED)
    used = np.flatnonzero(share > 0.0)
    at = draw.choice(len(share), PLACES, p=share)
    others = used if len(used) <= OTHERS else draw.choice(used, OTHERS, replace=False)
    outward = surface.vertex_normals[at] * np.sign(surface.volume)
    radius = inner_balls(surface.vertices[at], outward, surface.vertices[others])[1]
    return _width_where_thin(2.0 * radius, surface.diagonal)


def _mean_thickness(surface: Surface) -> float:
    """Return the mean thickness over the diagonal; infinite where it cannot be told."""
    if not 0.0 < surface.area < np.inf:
        return np.inf
    return 3.0 * abs(surface.volume) / (surface.area * surface.diagonal)


def _width_where_thin(widths: Array, diagonal: float) -> float:
    return float(np.median(widths)) if np.quantile(widths, MOST) < WALL * diagonal else 0.0
