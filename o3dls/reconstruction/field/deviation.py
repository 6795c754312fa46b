"""How far the wall of a reconstruction may be off, by its field given the points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...arrays import TINY, Array
from ...motion.field.covariance import WORTH
from ...parallel import by_rows
from ..neighbours import nearest
from ..settings import ReconstructionSettings
from .reconstruction import Reconstruction
from .spline_fit import bias_along
from .splines import correlation


class _Known(NamedTuple):
    """Points have feet (m, 3), the field's amplitude there, and the variance of their noise (m,)."""

    feet: Array
    amplitude: Array
    variance: Array


def deviation(
    vertices: Array, prior_sd: Array, found: Reconstruction, settings: ReconstructionSettings
) -> Array:
    """Return the standard deviation (v,) of the wall at its vertices, if there is wall.

    It is that of the field, or of the motion, prior_sd (v,), where that is larger, as far as the points next
    to each vertex leave it open. The bias of a curved wall adds to it, since the bends that give it are
    uncertain.
    """
    wall = found.wall
    _, near = nearest(wall.feet, vertices, min(settings.deviation_points, len(wall.feet)))
    variance = wall.noise**2 / np.maximum(wall.weights, TINY)
    # a wall that lies farther from the moved prior than expected is of a field that varies by so much there
    amplitude = np.hypot(wall.amplitude, found.prior.at(wall.feet))
    told = np.zeros(len(vertices))
    known = _Known(wall.feet, amplitude, variance)
    by_rows(_fill_explained_variance, WORTH, (vertices, near, told), known, np.asarray(found.lengths))
    # the field's was found from distances to the moved prior, which have the motion's in them
    left = np.sqrt(1.0 - told) * np.maximum(amplitude[near[:, 0]], prior_sd)
    bias = bias_along(wall, found.prior, found.field, settings.curved)
    return np.asarray(np.hypot(left, bias[near[:, 0]]))


@njit(cache=True, nogil=True)
def _fill_explained_variance(vertices, near, told, known, lengths):  # type: ignore[no-untyped-def]
    """Fill in the part (v,) of the field's variance at each vertex that the points near it explain, by the
    Cholesky factor of their covariance.
    """
    feet, amplitude, variance = known
    count = near.shape[1]
    factor = np.empty((count, count))
    across = np.empty(count)
    for v in range(len(vertices)):
        total = 0.0
        for i in range(count):
            a = near[v, i]
            across[i] = amplitude[a] * correlation(feet[a], vertices[v], lengths)
            for j in range(i + 1):
                b = near[v, j]
                entry = amplitude[a] * amplitude[b] * correlation(feet[a], feet[b], lengths)
                if i == j:
                    entry += variance[a]
                for k in range(j):
                    entry -= factor[i, k] * factor[j, k]
                factor[i, j] = np.sqrt(entry) if i == j else entry / factor[j, j]
            for k in range(i):
                across[i] -= factor[i, k] * across[k]
            across[i] /= factor[i, i]
            total += across[i] ** 2
        told[v] = min(total, 1.0)
