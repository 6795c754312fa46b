"""Where to map next: the places of the wall whose measurement would make the posterior surest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import TINY, Array, Ints, Mask
from ..case import Case
from ..errors import InputError
from ..estimate import Estimate
from ..geometry.cut_wall import on_cut
from ..geometry.inner_balls import depth_in_tubes
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface
from ..motion.recorded import WallModes
from .wall_modes import wall_modes

MEAN_OVER_SD = float(
    np.sqrt(2 / np.pi)
)  # mean absolute value of a normal variable over its standard deviation
LEAST_GAIN = 0.02  # share of the mean variance: less is not worth a point
APART = 0.2  # rms radii, 5 mm for an atrium: from points, from each other, and into tubes
AROUND = 0.4  # rms radii, 10 mm: the surroundings that a place is judged by


@dataclass(frozen=True)
class Place:
    """A place is worth measuring: it has xyz (d,) in the map frame, the surface's vertex there, and the
    distance to the nearest mapping point.

    Expected errors, before and after a point there, are means over the wall and over the surroundings; those
    before know of the places proposed earlier. gain is the share of the mean variance that the point takes.
    """

    xyz: Array
    vertex: int
    distance: float
    before: float
    after: float
    near_before: float
    near_after: float
    gain: float


@dataclass(frozen=True)
class Advice:
    """Advice lists places in the order of their worth, and says why there are fewer than asked for, if so."""

    places: tuple[Place, ...]
    ended: str = ""


@dataclass(frozen=True, eq=False)
class _Wall:
    """This is what is known of the wall while places are chosen: the covariance (m, m) of its sample, and the
    variance (m,) before any place was, and the vertices (m,) that it is of; for each vertex (n,) the nearest
    of the sample, deviation and weight.
    """

    covariance: Array
    first: Array
    vertex: Ints
    of: Ints
    sd: Array
    weights: Array

    @property
    def left(self) -> Array:
        """Share (m,) of the first variance that is left."""
        return np.asarray(np.diag(self.covariance) / self.first)

    @property
    def sd_now(self) -> Array:
        return self.sd * np.sqrt(self.left[self.of])

    def mean(self, values: Array, part: Mask | None = None) -> float:
        """Return the weighted mean over the vertices, or a part of them; plain where that has no weight."""
        weights = self.weights if part is None else self.weights * part
        if weights.sum() == 0.0:
            weights = np.ones(len(values)) if part is None else part.astype(np.float64)
        return float(weights @ values / weights.sum())

    def expected(self, part: Mask | None = None) -> float:
        """Return the mean error that is expected, of the wall or a part of it."""
        return MEAN_OVER_SD * self.mean(self.sd_now, part)

    def gains(self, noise: float, believed: float) -> Array:
        """Return the share (m,) of the mean variance that a point at each place takes."""
        worth = np.bincount(self.of, self.weights * self.sd**2, len(self.first))
        taken = (worth / self.first) @ self.covariance**2 / (np.diag(self.covariance) + noise**2)
        return np.asarray(believed * taken / max(float(worth @ self.left), TINY))

    def measured(self, at: int, noise: float, believed: float) -> _Wall:
        """Return the wall as expected after a point at a place: an outlier, which the point may be, tells
        nothing.
        """
        row = self.covariance[at]
        taken = believed * np.outer(row, row) / (row[at] + noise**2)
        return replace(self, covariance=self.covariance - taken)


def suggest(
    case: Case,
    estimate: Estimate,
    k: int = 5,
    *,
    weights: Array | None = None,
    reachable: Mask | None = None,
    unvisited: Sequence[Mask] = (),
) -> Advice:
    """Return the k places whose measurement lowers the mean posterior variance over the wall most, one after
    another, each with those before it in mind.

    Not proposed are places that are surer than the wall in the mean, that lie within 5 mm of a mapping point
    or of each other, deeper than 5 mm in a tube of the prior (for an atrium; 0.2 rms radii), or where the
    image ended. There are fewer than k where the next takes less than 2 % of the mean variance.

    Parameters
    ----------
    case : Case
        the case that was fitted.
    estimate : Estimate
        one with a joint posterior: of stage `deform`, or of one behind it.
    k : int, default 5
        how many places to propose at most.
    weights : array (n,), default 1
        how much each vertex of the estimate's surface counts beside its area.
    reachable : array of bool (n,), default everywhere
        where the catheter can get.
    unvisited : sequence of arrays of bool (n,), default none
        parts of the wall where no point was taken, such as a vein: each that can be reached is proposed,
        though it is too small to change the mean.

    Returns
    -------
    Advice
        `places`, each with `xyz` (3,) in the map frame, mm, and the errors expected before and after a point
        there; `ended` says why there are fewer.

    Raises
    ------
    InputError
        where the estimate has no posterior, or an argument does not fit its surface.

    Examples
    --------
    >>> import o3dls
    >>> run = o3dls.read_run("run")
    >>> advice = o3dls.suggest(run.case, run.estimates["deform"], k=1)
    >>> all(place.after < place.before for place in advice.places)
    True
    """
    modes = wall_modes(case.prior, estimate.motion)
    if modes is None or estimate.motion is None or not estimate.sigma:
        raise InputError(
            f"case {case.name}: the estimate has no joint posterior, so the next places cannot be "
            "found; run a pipeline with the stage 'deform' again, with this version"
        )
    if k < 1:
        raise InputError(f"k = {k}: must be at least 1")
    n = len(estimate.surface.vertices)
    can = np.ones(n) if reachable is None else _check_weights("reachable", reachable, n)
    reachable = (can > 0) & ~on_cut(estimate.surface)
    weights = np.ones(n) if weights is None else _check_weights("weights", weights, n)
    at = estimate.motion(case.prior.vertices[modes.places])
    wall = _describe_wall(case, estimate, modes, at, weights)
    shallow = _tube_depths(case.prior, modes.places.tobytes()) < APART
    parts = [(reachable & part)[wall.vertex] for part in unvisited]
    parts = [part & shallow if (part & shallow).any() else part for part in parts]
    return _choose_places(case, estimate, wall, reachable[wall.vertex] & shallow, parts, k)


@lru_cache(maxsize=2)  # a session asks for the same prior again and again
def _tube_depths(prior: Surface, places: bytes) -> Array:
    """Return how deep (m,) vertices of the prior lie in its tubes, in rms radii."""
    at = np.frombuffer(places, dtype=np.int64)
    deep = depth_in_tubes(prior.vertices[at], prior.vertex_normals[at], prior.vertices)
    return deep / rms_radius(prior.vertices)


def _check_weights(name: str, given: Array | Mask, n: int) -> Array:
    values = np.asarray(given, dtype=np.float64)
    if values.shape != (n,):
        raise InputError(f"{name} has shape {values.shape}: the estimate's surface has {n} vertices")
    if not np.isfinite(values).all() or (values < 0.0).any() or not values.any():
        raise InputError(f"{name}: must be finite, not negative, and above 0 somewhere")
    return values


def _describe_wall(case: Case, estimate: Estimate, modes: WallModes, at: Array, weights: Array) -> _Wall:
    surface = estimate.surface
    covariance = modes.modes @ modes.modes.T
    first = np.maximum(np.diag(covariance), TINY)
    vertex = np.asarray(cKDTree(surface.vertices).query(at)[1], dtype=np.int64)
    of = np.asarray(cKDTree(at).query(surface.vertices)[1], dtype=np.int64)
    sd = np.asarray(surface.fields.get(f"sd_{case.units}", np.sqrt(first)[of]), dtype=np.float64)
    known = np.isfinite(sd)
    weights = weights * surface.vertex_areas * known
    return _Wall(covariance, first, vertex, of, np.where(known, sd, 0.0), weights)


def _choose_places(
    case: Case, estimate: Estimate, wall: _Wall, allowed: Mask, parts: list[Mask], k: int
) -> Advice:
    """Return the places of highest worth among those allowed (m,), and then one in each part (m,) without a
    point that none of them is in.
    """
    at = estimate.surface.vertices[wall.vertex]
    apart = APART * rms_radius(estimate.surface.vertices)
    points = estimate.corrected(case).points.of("eam").xyz
    distance = np.asarray(cKDTree(points).query(at)[0]) if len(points) else np.full(len(at), np.inf)
    sigma = estimate.sigma or 0.0
    believed = 1.0 if estimate.weights is None else float(estimate.weights.mean())
    free = distance > apart
    found, ended = list[Place](), ""
    while len(found) < k:
        gains = wall.gains(sigma, believed)
        best, ended = _find_best(wall, allowed & free, gains)
        if ended:
            best = _find_best_in_parts(parts, free, gains)
        if best is None:
            break
        after = wall.measured(best, sigma, believed)
        near = np.linalg.norm(estimate.surface.vertices - at[best], axis=1) < AROUND / APART * apart
        found.append(
            Place(
                xyz=at[best],
                vertex=int(wall.vertex[best]),
                distance=float(distance[best]),
                before=wall.expected(),
                after=after.expected(),
                near_before=wall.expected(near),
                near_after=after.expected(near),
                gain=float(gains[best]),
            )
        )
        free &= np.linalg.norm(at - at[best], axis=1) > apart
        parts = [part for part in parts if not part[best]]
        wall = after
    return Advice(tuple(found), ended if len(found) < k else "")


def _find_best(wall: _Wall, allowed: Mask, gains: Array) -> tuple[int | None, str]:
    """Return the place of the highest gain that is worth a point; else None, and why there is none."""
    open_ = allowed & (wall.sd_now[wall.vertex] > wall.mean(wall.sd_now))
    if not open_.any():
        return None, "no further place is reachable, unsure and away from the points"
    best = int(np.where(open_, gains, -1.0).argmax())
    if gains[best] < LEAST_GAIN:
        return None, f"one more point would lower the mean variance by less than {LEAST_GAIN:.0%}"
    return best, ""


def _find_best_in_parts(parts: list[Mask], free: Mask, gains: Array) -> int | None:
    """Return the place of the highest gain in the parts without a point; None where there is none."""
    open_ = np.any([part & free for part in parts], axis=0) if parts else np.zeros(len(free), dtype=bool)
    return int(np.where(open_, gains, -1.0).argmax()) if open_.any() else None
