"""How the posterior's errors go together over the wall, at places spread evenly over the prior."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg.lapack import dpstrf

from ..arrays import ROUNDING, Ints
from ..geometry.spread import spread
from ..geometry.surface import Surface
from ..motion.motion import FittedMotion
from ..motion.recorded import Motion, RecordedMotion, WallModes

PLACES = 500  # 4 to 5 mm apart on an atrium: a third of the shortest correlation length
MODES = 250  # they hold at least 98 % of the variance of an atrium's posterior


@lru_cache(maxsize=4)  # estimates of one run share their motion
def wall_modes(prior: Surface, motion: Motion | None) -> WallModes | None:
    """Return the joint posterior of a motion of the prior by the first columns of its pivoted Cholesky
    factor, which takes a tenth of the time of eigenvectors; None where it has none, or its run did not keep
    it.
    """
    if isinstance(motion, RecordedMotion):
        return motion.modes
    if not isinstance(motion, FittedMotion):
        return None
    places = _spread_places(prior)
    normals = prior.with_vertices(motion(prior.vertices)).vertex_normals[places]
    joint = motion.joint(prior.vertices[places], normals)
    factor, pivots, rank, _ = dpstrf(joint, tol=ROUNDING * float(joint.max()), lower=True)
    modes = np.empty((len(places), min(int(rank), MODES)))
    modes[pivots - 1] = np.tril(factor)[:, : modes.shape[1]]
    return WallModes(places, modes)


@lru_cache(maxsize=2)  # a session asks for the same prior again and again
def _spread_places(prior: Surface) -> Ints:
    return spread(prior.vertices, PLACES)
