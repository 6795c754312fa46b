"""How the posterior's errors go together over the wall, at places spread evenly over the prior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..arrays import ROUNDING, Array, Ints
from ..geometry.surface import Surface
from ..motion.interface import Motion
from ..motion.motion import FittedMotion
from ..motion.recorded import RecordedMotion, WallModes

PLACES = 500  # 4 to 5 mm apart on an atrium: a third of the shortest correlation length
MODES = 150  # of an atrium's posterior they hold 99 %


@dataclass(frozen=True, eq=False)
class WallPosterior:
    """The joint posterior at some vertices `places` (m,) of the prior: where they came to lie, at (m, d), and
    the covariance (m, m) of their errors along the moved normals.
    """

    places: Ints
    at: Array
    covariance: Array


def wall_posterior(prior: Surface, motion: Motion | None) -> WallPosterior | None:
    """The joint posterior of a motion of the prior; None where it has none, or its run did not keep it."""
    if isinstance(motion, RecordedMotion):
        if motion.modes is None:
            return None
        places, modes = motion.modes.places, motion.modes.modes
        return WallPosterior(places, motion(prior.vertices[places]), modes @ modes.T)
    if not isinstance(motion, FittedMotion):
        return None
    places, moved = _places(prior), motion(prior.vertices)
    normals = prior.with_vertices(moved).vertex_normals[places]
    return WallPosterior(places, moved[places], motion.joint(prior.vertices[places], normals))


@lru_cache(maxsize=4)  # of the estimates of one run that share their motion
def wall_modes(prior: Surface, motion: Motion | None) -> WallModes | None:
    """The strongest modes of the joint posterior, which a run folder keeps."""
    if isinstance(motion, RecordedMotion):
        return motion.modes
    if (found := wall_posterior(prior, motion)) is None:
        return None
    values, vectors = np.linalg.eigh(found.covariance)
    strongest = np.flatnonzero(values > ROUNDING * values[-1])[::-1][:MODES]
    return WallModes(found.places, vectors[:, strongest] * np.sqrt(values[strongest]))


@lru_cache(maxsize=2)  # of the prior of a session that is asked again and again
def _places(prior: Surface) -> Ints:
    return spread(prior.vertices, PLACES)


def spread(points: Array, count: int) -> Ints:
    """Indices of at most `count` points (n, d), each the farthest from those before it; the first is the
    farthest from the middle.
    """
    gap = np.full(len(points), np.inf)
    found = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())]
    while len(found) < min(count, len(points)):
        gap = np.minimum(gap, ((points - points[found[-1]]) ** 2).sum(axis=1))
        if gap.max() == 0.0:
            break
        found.append(int(gap.argmax()))
    return np.array(found)
