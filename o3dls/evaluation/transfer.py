"""Electrical values between points and surfaces: projected to the wall or carried along a motion, masked
where nothing is known.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Ints
from ..case import Points
from ..errors import InputError, did_you_mean
from ..geometry.closest_point import ClosestPoint
from ..geometry.surface import Surface, interpolated

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Motion = Callable[[Array], Array]
NEIGHBOURS = 64  # data that one vertex averages at most
BLOCK = 4096  # vertices taken together, which bounds the memory
REACH = 10.0  # mm: farther from every point nothing is claimed
MOST_PROCESS_POINTS = 5000
LENGTHS = (4.0, 8.0, 16.0, 32.0, 64.0)
NOISES = (0.01, 0.03, 0.1, 0.3, 1.0)  # of the signal's deviation
WIDTH = 4.0  # mm: deviation of the Gaussian that averages the data
# columns and their units
ELECTRICAL = {
    "bipolar": "mV",
    "unipolar": "mV",
    "lat": "ms",
    "force": "g",
    "impedance": "ohm",
}


@dataclass(frozen=True, eq=False)
class Projection:
    """Where points (k, d) meet a surface: distance (k,), face (k,), foot (k, d) and barycentric weights (k,
    d) in it.
    """

    distance: Array
    face: Ints
    foot: Array
    weights: Array


@dataclass(frozen=True, eq=False)
class Carried:
    """Values per vertex, NaN outside `known`; deviation (n,) where the interpolator gives one; distance (n,)
    to the nearest datum.
    """

    values: Array
    known: NDArray[np.bool_]
    distance: Array
    sd: Array | None = None


def project(xyz: Array, surface: Surface) -> Projection:
    """The closest points of a surface to points (k, d)."""
    squared, face, foot, weights = ClosestPoint(surface.vertices, surface.faces).query(
        np.asarray(xyz, dtype=np.float64)
    )
    return Projection(np.sqrt(squared), face, foot, weights)


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
        raise InputError(f"method '{method}' is no interpolator" + did_you_mean(method, list(METHODS)))
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
    """Interpolate the point on the unit circle that each time is, then read the angle: early meets late
    without a step between.
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
    from scipy.spatial import cKDTree

    found = cKDTree(wall.foot).query(surface.vertices, k=np.arange(1, min(NEIGHBOURS, len(values)) + 1))
    distance, row = np.asarray(found[0]), np.asarray(found[1])
    # the nearest has weight 1: no underflow
    weights = np.exp((distance[:, :1] ** 2 - distance**2) / (2 * width**2))
    return (weights * values[row]).sum(axis=1) / weights.sum(axis=1), None


def _harmonic(wall: Projection, values: Array, surface: Surface, width: float) -> tuple[Array, Array | None]:
    """Least Dirichlet energy, the data held by springs; `width` is the distance over which one datum yields
    to its neighbours.
    """
    from scipy.sparse import coo_array, diags_array
    from scipy.sparse.linalg import spsolve

    n = len(surface.vertices)
    k = len(values)
    rows = np.repeat(np.arange(k), surface.dimension)
    sample = coo_array((wall.weights.ravel(), (rows, surface.faces[wall.face].ravel())), shape=(k, n)).tocsr()
    # measured: width 4 mm keeps a smooth field and takes half of independent noise
    softness = (width / 10.0) ** 2
    mean = values.mean()
    anchor = 1e-9 * diags_array(np.ones(n))  # a piece without any datum rests at the mean
    system = softness * stiffness(surface) + sample.T @ sample + anchor
    return mean + np.asarray(spsolve(system.tocsc(), sample.T @ (values - mean))), None


def stiffness(surface: Surface) -> csr_array:
    """Dirichlet energy of linear elements, (n, n): cotangent weights on triangles, 1/length on segments."""
    from scipy.sparse import coo_array

    faces = surface.faces
    d = surface.dimension
    n = len(surface.vertices)
    corners = surface.vertices[faces]
    opposite = (
        np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1)
        if d == 3
        else np.stack([-np.ones(len(faces)), np.ones(len(faces))], 1)[..., None]
    )
    size = np.maximum(surface.face_areas, 1e-12)
    local = np.einsum("mik,mjk->mij", opposite, opposite) / ((4.0 if d == 3 else 1.0) * size)[:, None, None]
    rows = np.repeat(faces, d, axis=1)
    columns = np.tile(faces, (1, d))
    return coo_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()


def _process(wall: Projection, values: Array, surface: Surface, width: float) -> tuple[Array, Array | None]:
    """Gaussian process of Matern 3/2 covariance; length and noise are the likeliest of a grid, which makes
    `width` superfluous.
    """
    from scipy.linalg import solve_triangular
    from scipy.spatial.distance import cdist

    if len(values) > MOST_PROCESS_POINTS:
        raise InputError(
            f"{len(values)} points are too many for a Gaussian process: at most {MOST_PROCESS_POINTS}; "
            "use method 'gaussian'"
        )
    mean = values.mean()
    scale = max(float(values.std()), 1e-12)
    y = (values - mean) / scale
    between = cdist(wall.foot, wall.foot)
    some = np.linspace(0, len(y) - 1, min(len(y), 500)).astype(int)  # enough to choose by
    length, noise = min(
        ((a, b) for a in LENGTHS for b in NOISES),
        key=lambda c: _minus_log_likelihood(between[np.ix_(some, some)], y[some], *c),
    )
    lower = np.linalg.cholesky(_matern(between, length) + noise**2 * np.eye(len(y)))
    weights = solve_triangular(lower.T, solve_triangular(lower, y, lower=True))
    found, sd = np.empty(len(surface.vertices)), np.empty(len(surface.vertices))
    for start in range(0, len(found), BLOCK):
        block = slice(start, start + BLOCK)
        cross = _matern(cdist(surface.vertices[block], wall.foot), length)
        explained = (solve_triangular(lower, cross.T, lower=True) ** 2).sum(axis=0)
        found[block] = mean + scale * cross @ weights
        sd[block] = scale * np.sqrt(np.maximum(1.0 - explained, 0.0))
    return found, sd


def _matern(distance: Array, length: float) -> Array:
    scaled = np.sqrt(3.0) * distance / length
    return np.asarray((1.0 + scaled) * np.exp(-scaled))


def _minus_log_likelihood(between: Array, y: Array, length: float, noise: float) -> float:
    from scipy.linalg import solve_triangular

    lower = np.linalg.cholesky(_matern(between, length) + noise**2 * np.eye(len(y)))
    return float(np.log(np.diag(lower)).sum() + 0.5 * (solve_triangular(lower, y, lower=True) ** 2).sum())


Interpolator = Callable[[Projection, Array, Surface, float], tuple[Array, Array | None]]
METHODS: Mapping[str, Interpolator] = {
    "nearest": _nearest,
    "gaussian": _gaussian,
    "harmonic": _harmonic,
    "process": _process,
}


def between(
    source: Surface,
    target: Surface,
    *,
    source_motion: Motion | None = None,
    target_motion: Motion | None = None,
    reach: float = REACH,
    cycles: Mapping[str, float] | None = None,
) -> Surface:
    """The target with the source's fields, read where the two surfaces meet once each has been moved by its
    motion.

    Give `source_motion` (such as an estimate's motion) to bring fields of the prior to the refined surface,
    `target_motion` to bring fields of the map back to the prior: a place is then followed through the
    deformation instead of taken for the nearest wall, which may be another one. Vertices farther than `reach`
    from the source are NaN, as are those between corners without a value. `cycles` names the fields that are
    times on a circle, and its length.
    """
    moved = source if source_motion is None else source.with_vertices(source_motion(source.vertices))
    places = target.vertices if target_motion is None else target_motion(target.vertices)
    wall = project(places, moved)
    far = wall.distance > reach
    corners = moved.faces[wall.face]
    fields = dict(target.fields)
    for name, values in source.fields.items():
        cycle = (cycles or {}).get(name)
        found = (
            interpolated(values, corners, wall.weights)
            if cycle is None
            else _mean_time(values, corners, wall.weights, cycle)
        )
        found[far] = np.nan
        fields[name] = found
    return replace(target, fields=fields)


def _mean_time(times: Array, corners: Ints, weights: Array, cycle: float) -> Array:
    """Weighted mean (n,) of times (v,) on a circle at corners (n, d), near that of the heaviest."""
    heaviest = times[np.take_along_axis(corners, weights.argmax(axis=1)[:, None], axis=1)]
    apart = np.mod(times[corners] - heaviest + cycle / 2, cycle) - cycle / 2
    return np.asarray(heaviest[:, 0] + np.where(weights > 0.0, weights * apart, 0.0).sum(axis=1))


def with_electrical(
    surface: Surface, points: Points, *, columns: Collection[str] = tuple(ELECTRICAL)
) -> Surface:
    """The surface with every one of these columns that the eam points carry, interpolated, NaN where no value
    is near.
    """
    fields = dict(surface.fields)
    for name, (xyz, values) in measured_values(points, columns).items():
        near = (project(xyz, surface).distance <= REACH).any()
        fields[name] = (
            to_surface(xyz, values, surface).values if near else np.full(len(surface.vertices), np.nan)
        )
    return replace(surface, fields=fields)


def measured_values(
    points: Points, columns: Collection[str] = tuple(ELECTRICAL)
) -> dict[str, tuple[Array, Array]]:
    """Positions (k, d) and values (k,) of each of these columns of the eam points that holds any number."""
    eam = points.of("eam")
    found = dict[str, tuple[Array, Array]]()
    for name in columns:
        values = eam.columns.get(name)
        if values is not None and values.dtype.kind in "fiu" and np.isfinite(values).any():
            known = np.isfinite(values)
            found[name] = (eam.xyz[known], np.asarray(values[known], dtype=np.float64))
    return found
