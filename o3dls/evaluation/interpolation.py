"""Values measured at points as values per vertex of a surface, NaN where nothing is known."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from .. import parallel
from ..arrays import Array, Ints, without_masked
from ..errors import InputError
from ..geometry.surface import Surface
from .projection import project

NEIGHBOURS = 64  # data that one vertex averages at most
REACH = 10.0  # mm: farther from every point nothing is claimed
WIDTH = 4.0  # mm: deviation of the Gaussian that averages the data


def to_surface(xyz: Array, values: Array, surface: Surface) -> Array:
    """Return values (n,) per vertex of a surface from values (k,) measured at points (k, d) in its frame.

    Each is the mean of the nearest data by a Gaussian of deviation WIDTH on the wall. Points without a value
    or farther than REACH from the wall are left out; vertices farther than REACH from every datum are NaN.
    Raises InputError for arrays that do not fit together, or where no point has a value near the wall.
    """
    xyz, values = without_masked(xyz).astype(np.float64), without_masked(values).astype(np.float64)
    if xyz.shape != (values.size, surface.dimension) or values.ndim != 1:
        raise InputError(
            f"points {xyz.shape} and values {values.shape}: must be (k, {surface.dimension}) and (k,)"
        )
    wall = project(xyz, surface)
    used = np.isfinite(values) & (wall.distance <= REACH)
    if not used.any():
        raise InputError(
            f"none of {len(values)} points has a value and lies within {REACH:g} mm of the surface"
        )
    distance, row = _nearest_data(wall.foot[used].tobytes(), surface)
    # the nearest has weight 1: no underflow, however far it is
    weights = np.exp((distance[:, :1] ** 2 - distance**2) / (2 * WIDTH**2))
    mean = (weights * values[used][row]).sum(axis=1) / weights.sum(axis=1)
    return np.where(distance[:, 0] <= REACH, mean, np.nan)


@lru_cache(maxsize=1)  # the columns of a map are mostly measured at the same points
def _nearest_data(data: bytes, surface: Surface) -> tuple[Array, Ints]:
    """Return distances and rows (n, k) of the data (m, d) that are nearest to each vertex, the nearest
    first.
    """
    from scipy.spatial import cKDTree

    places = np.frombuffer(data).reshape(-1, surface.dimension)
    nearest = np.arange(1, min(NEIGHBOURS, len(places)) + 1)
    distance, row = cKDTree(places).query(surface.vertices, k=nearest, workers=parallel.THREADS)
    return np.asarray(distance), np.asarray(row)
