"""The activation of a wall by points that know the time at which a wave came past."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Array, Ints, Mask
from ...errors import InputError
from ...geometry.spread import spread
from ...geometry.surface import Surface
from ..interpolation import REACH
from ..projection import project
from .features import make_features
from .harmonics import Harmonics
from .learning import learn_process
from .posterior import TimePosterior
from .velocity import Told, Velocity, find_velocity, sample_speeds
from .winding import SD, choose_length, find_wave, phase_slopes, phase_times, wrap

FEWEST = 20  # times of a map
MOST = 1000  # points that are told apart
SAME_AS_SD = 1.4826  # of the median distance from the median, for a Gaussian
SPACINGS, NEAR = 1.2, 5.0  # a map tells nothing farther from its points, see `find_known`
CIRCULAR = (SD * 2.0 / np.pi, 0.25, 0.15)  # of `BEGIN`, in quarters of a cycle


@dataclass(frozen=True, eq=False)
class ActivationMap:
    """An activation map has the times (n,) in ms at the vertices, within a cycle where there is one (ms).

    They are `base` (n,) and the mean of the posterior. slope (n, 2) of the times and its covariance (n, 2,
    2) lie along `harmonics.frames`. told (n,): why no velocity is (`Told`). known (n,): where there is a map.
    rows: which of the points are used.
    """

    posterior: TimePosterior
    base: Array
    time: Array
    velocity: Velocity
    slope: Array
    covariance: Array
    told: Ints
    known: Mask
    rows: Ints
    cycle: float | None

    @property
    def sd(self) -> Array:
        return self.posterior.sd

    @property
    def trust(self) -> Array:
        return self.posterior.process.trust

    @property
    def vectors(self) -> Array:
        """Velocities (n, 3) in m/s, NaN where none is told."""
        along = np.einsum("na,nad->nd", self.velocity.direction, self.posterior.harmonics.frames)
        return np.where(self.has_velocity[:, None], self.velocity.speed[:, None] * along, np.nan)

    @property
    def has_velocity(self) -> Mask:
        """Vertices (n,) where a velocity is told."""
        return np.asarray(self.told == Told.VELOCITY)

    def samples(self, count: int, seed: int) -> tuple[Array, Array]:
        """Return joint samples (count, n) of the times, not taken back into a cycle, and of the speeds."""
        drawn = self.posterior.samples(count, np.random.default_rng(seed))
        mean = self.posterior.mean
        slopes = np.moveaxis(self.posterior.harmonics.slopes((drawn - mean).T), (0, 1, 2), (2, 1, 0))
        speeds = sample_speeds(self.velocity, self.slope, self.covariance, self.slope + slopes)
        return self.base + drawn, speeds


def map_activation(
    surface: Surface,
    xyz: Array,
    times: Array,
    *,
    wall: Mask | None = None,
    errors: Array | None = None,
    cycle: float | None = None,
) -> ActivationMap:
    """Map activation times (k,) in ms of points (k, 3) over a surface in mm.

    wall (n,): vertices where there is wall; default all. errors (s, n, 3): samples of how far each vertex
    lies from where it should. cycle: ms after which the wave comes again. Of more than `MOST` points those
    are used that lie farthest from each other. Raises InputError where fewer than `FEWEST` points have a time
    and lie near the wall, or all times are the same.
    """
    wall = np.ones(len(surface.vertices), dtype=bool) if wall is None else wall
    met = project(xyz, surface)
    on_wall = wall[surface.faces[met.face]].all(axis=1)
    rows = np.flatnonzero(np.isfinite(times) & (met.distance <= REACH) & on_wall)
    if len(rows) < FEWEST:
        raise InputError(f"{len(rows)} points have a time and lie near the wall: must be at least {FEWEST}")
    if len(rows) > MOST:
        rows = rows[np.sort(spread(met.foot[rows], MOST))]
    times = times[rows]
    if not np.ptp(times) > 0.0:
        raise InputError("the times of all points are the same: must be measured, so that they vary")
    harmonics = Harmonics.of(surface, wall)
    corners, weights = surface.faces[met.face[rows]], met.weights[rows]
    at = np.einsum("kc,kcm->km", weights, harmonics.values[corners])
    base, base_slope, posterior = _fit(harmonics, at, times, cycle)
    if errors is not None:
        shift = np.einsum("kc,skcd->skd", weights, errors[:, corners])
        posterior = _allow_for_place(posterior, base_slope, (corners, weights), shift)
    slope, covariance = posterior.slopes()
    slope += base_slope
    velocity = find_velocity(slope, covariance)
    known = wall & find_known(surface, met.foot[rows])
    time = base + posterior.mean
    time = time if cycle is None else time % cycle
    return ActivationMap(
        posterior, base, time, velocity, slope, covariance, velocity.tell(known), known, rows, cycle
    )


def find_known(surface: Surface, points: Array) -> Mask:
    """Return the vertices (n,) that points (k, 3) are near to: as far as the map's points are apart, and a
    little more.
    """
    gap = cKDTree(points).query(surface.vertices)[0]
    spacing = np.sqrt(float(surface.vertex_areas @ (gap <= REACH)) / len(points))
    return np.asarray(gap <= min(REACH, max(NEAR, SPACINGS * spacing)))


def _allow_for_place(
    posterior: TimePosterior, base_slope: Array, at: tuple[Ints, Array], shift: Array
) -> TimePosterior:
    """Return the posterior where points, at corners (k, 3) with weights (k, 3), may be off by shifts (s, k,
    3): their times are off by the slope times that. How unsure the slope is adds to the variance.
    """
    corners, weights = at
    frames = posterior.harmonics.frames[corners]
    vertices, of = np.unique(corners, return_inverse=True)
    slope, covariance = (found[of.reshape(corners.shape)] for found in posterior.slopes(vertices))
    steep = base_slope[corners] + slope
    missed = np.einsum("kc,kca,kcad,skd->sk", weights, steep, frames, shift)
    square = np.einsum("ski,skj->kij", shift, shift) / len(shift)
    unsure = np.einsum("kc,kcab,kcai,kcbj,kij->k", weights, covariance, frames, frames, square)
    return replace(posterior, misplaced=missed.T @ missed / len(missed) + np.diag(unsure))


def _fit(
    harmonics: Harmonics, at: Array, times: Array, cycle: float | None
) -> tuple[Array, Array, TimePosterior]:
    """Return times (n,) that the process is about, their slope (n, 2), and the posterior of what is beside
    them: one time everywhere, or a wave that goes round and round.
    """
    none = np.zeros((len(times), len(times)))
    if cycle is None:
        middle = float(np.median(times))
        about = np.full(len(harmonics.values), middle), np.zeros((len(harmonics.values), 2))
        seen, asked = (make_features(harmonics, one) for one in (at, harmonics.values))
        scale = SAME_AS_SD * float(np.median(np.abs(times - middle))) or float(times.std())
        process = learn_process(seen, times - middle, scale, float(np.ptp(times)))
        return *about, TimePosterior(harmonics, process, seen, asked, times - middle, none)
    points, vertices = find_wave(harmonics, at, times, cycle)
    left = wrap(times - phase_times(points, cycle), cycle)
    length = choose_length(cycle)
    seen = make_features(harmonics, at, length, points)
    asked = make_features(harmonics, harmonics.values, length, vertices)
    process = learn_process(seen, left, cycle / 4.0, cycle, np.array(CIRCULAR))
    about = phase_times(vertices, cycle), phase_slopes(harmonics, vertices, cycle).T
    return *about, TimePosterior(harmonics, process, seen, asked, left, none)
