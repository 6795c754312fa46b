"""Values measured at points as values per vertex of a surface, masked where nothing is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .. import parallel
from ..arrays import Array, Ints
from ..errors import InputError, did_you_mean
from ..geometry.surface import Surface
from .gaussian_process import process
from .harmonic import harmonic
from .projection import Projection, project

NEIGHBOURS = 64  # data that one vertex averages at most
REACH = 10.0  # mm: farther from every point nothing is claimed
WIDTH = 4.0  # mm: deviation of the Gaussian that averages the data


@dataclass(frozen=True, eq=False)
class Carried:
    """Values per vertex, NaN outside `known`, and how sure they are.

    Deviation (n,) where the interpolator gives one; distance (n,) to the nearest datum.
    """

    values: Array
    known: NDArray[np.bool_]
    distance: Array
    sd: Array | None = None


def to_surface(
    xyz: Array,
    values: Array,
    surface: Surface,
    *,
    method: str = "gaussian",
    reach: float = REACH,
    width: float = WIDTH,
    cycle: float | None = None,
) -> Carried:
    """Values (k,) measured at points (k, d) as values per vertex of a surface in the same frame.

    method: `nearest` datum; `gaussian` mean of deviation `width`; `harmonic`, smoothest on the surface;
    `process`, a Gaussian process with its deviation. Points without a value or farther than `reach` from the
    wall are left out, and vertices farther than `reach` from every datum are not known. With a `cycle` (ms)
    values are times on a circle of that length and stay within the measured window. Raises InputError for an
    unknown method, arrays that do not fit together, or where no point has a value near the wall.
    """
    if method not in METHODS:
        raise InputError(
            f"method '{method}' is not an interpolation method" + did_you_mean(method, list(METHODS))
        )
    if not (reach > 0 and width > 0 and (cycle is None or 0 < cycle < np.inf)):
        raise InputError(
            f"reach {reach}, width {width} and cycle {cycle} must be positive, and the cycle finite"
        )
    xyz, values = np.asarray(xyz, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if xyz.shape != (values.size, surface.dimension) or values.ndim != 1:
        raise InputError(
            f"points {xyz.shape} and values {values.shape}: must be (k, {surface.dimension}) and (k,)"
        )
    wall = project(xyz, surface)
    used = np.isfinite(values) & (wall.distance <= reach)
    if not used.any():
        raise InputError(
            f"none of {len(values)} points has a value and lies within {reach:g} mm of the surface"
        )
    near = Projection(wall.distance[used], wall.face[used], wall.foot[used], wall.weights[used])
    distance = _nearest_distance(near.foot, surface.vertices)
    known = distance <= reach
    interpolate = METHODS[method]
    if cycle is None or interpolate is _nearest:
        found, sd = interpolate(near, values[used], surface, width)
    else:
        found, sd = _on_circle(interpolate, near, values[used], surface, width, cycle)
    return Carried(
        np.where(known, found, np.nan), known, distance, None if sd is None else np.where(known, sd, np.nan)
    )


def _nearest_distance(data: Array, places: Array) -> Array:
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(data).query(places)[0])


def _on_circle(
    interpolate: Interpolator, wall: Projection, values: Array, surface: Surface, width: float, cycle: float
) -> tuple[Array, Array | None]:
    """Interpolate the point on the unit circle that each time is, then read the angle.

    Early meets late without a step between.
    """
    angle = 2 * np.pi * values / cycle
    (x, sd_x), (y, sd_y) = (
        interpolate(wall, part, surface, width) for part in (np.cos(angle), np.sin(angle))
    )
    first, last = values.min(), values.max()
    # a full circle around it holds the window, whose ends rounding must not exchange
    middle = 0.5 * (first + last)
    times = middle + np.mod(np.arctan2(y, x) * cycle / (2 * np.pi) - middle + cycle / 2, cycle) - cycle / 2
    times = np.clip(times, first, last)
    if sd_x is None or sd_y is None:
        return times, None
    length = np.maximum(np.hypot(x, y), 1e-9)
    across = np.hypot(sd_x * y, sd_y * x) / length  # deviation along the tangent of the circle
    # never more than of a uniform angle
    return times, np.minimum(across / length, np.pi / np.sqrt(3)) * cycle / (2 * np.pi)


def _nearest(wall: Projection, values: Array, surface: Surface, width: float) -> tuple[Array, Array | None]:
    from scipy.spatial import cKDTree

    return values[cKDTree(wall.foot).query(surface.vertices)[1]], None


def _gaussian(wall: Projection, values: Array, surface: Surface, width: float) -> tuple[Array, Array | None]:
    """Weighted mean of the nearest data; a vertex beyond all weights takes the very nearest."""
    distance, row = _neighbours(wall.foot.tobytes(), surface)
    # the nearest has weight 1: no underflow
    weights = np.exp((distance[:, :1] ** 2 - distance**2) / (2 * width**2))
    return (weights * values[row]).sum(axis=1) / weights.sum(axis=1), None


@lru_cache(maxsize=1)  # the columns of a map are mostly measured at the same points
def _neighbours(data: bytes, surface: Surface) -> tuple[Array, Ints]:
    """Distances and rows (n, k) of the data (m, d) that are nearest to each vertex, the nearest first."""
    from scipy.spatial import cKDTree

    places = np.frombuffer(data).reshape(-1, surface.dimension)
    nearest = np.arange(1, min(NEIGHBOURS, len(places)) + 1)
    distance, row = cKDTree(places).query(surface.vertices, k=nearest, workers=parallel.THREADS)
    return np.asarray(distance), np.asarray(row)


Interpolator = Callable[[Projection, Array, Surface, float], tuple[Array, Array | None]]
METHODS: Mapping[str, Interpolator] = {
    "nearest": _nearest,
    "gaussian": _gaussian,
    "harmonic": harmonic,
    "process": process,
}
