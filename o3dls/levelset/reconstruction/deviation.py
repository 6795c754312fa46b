"""How far the wall of a reconstruction may be off: the deviation of its field given the points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit

from ...arrays import TINY, Array
from ...geometry.surface import Surface
from ...motion.covariance import WORTH
from ...parallel import by_rows
from .normals import nearest
from .reconstruct import Believed, Reconstruction
from .settings import ReconstructionSettings
from .splines import correlation
from .surplus import evenness, most_by_chance


def deviation(
    vertices: Array, prior_sd: Array, found: Reconstruction, settings: ReconstructionSettings
) -> Array:
    """Standard deviation (v,) of the wall at its vertices: of the field or of the motion, prior_sd (v,),
    whichever is larger, as far as the points next to each do not tell; and, as far as there may be no wall,
    the distance to the wall that points show, which reaches halfway from each to the next.
    """
    wall = found.wall
    gap, near = nearest(wall.feet, vertices, min(settings.deviation_points, len(wall.feet)))
    variance = wall.noise**2 / np.maximum(wall.weights, TINY)
    told = np.zeros(len(vertices))
    shared = (wall.feet, wall.amplitude, variance, np.asarray(found.lengths))
    by_rows(_told, WORTH, (vertices, near, told), *shared)
    # the field's was found from distances to the moved prior, which have the motion's in them
    smooth = (1.0 - told) * np.maximum(wall.amplitude[near[:, 0]], prior_sd) ** 2
    unlikely = absent(gap[:, 0], found.between, found.gradient, settings)
    beyond = np.maximum(gap[:, 0] - 0.5 * found.between, 0.0)
    return np.asarray(np.sqrt(smooth + unlikely * beyond**2))


def with_doubt(surface: Surface, believed: Believed, sd: str, settings: ReconstructionSettings) -> Surface:
    """A moved prior that stays as it is, whose field `sd` has the probability that wall is not there which an
    even map lacks points on. Of one with more such wall a part was not visited, and smaller gaps are chance.
    """
    points = believed.points[believed.weights > 0.5]
    told = sd in surface.fields and len(points) >= settings.least_points
    if not told or evenness(points, surface, settings.surplus) > most_by_chance(
        len(points), settings.surplus
    ):
        return surface
    gap = nearest(points, surface.vertices, 1)[0][:, 0]
    between = float(np.sqrt(surface.area / len(believed.points)))
    bare = gap > settings.unmapped * between
    if bare.mean() > settings.surplus.elsewhere:
        return surface
    unlikely = np.where(bare, absent(gap, between, believed.gradient, settings), 0.0)
    deviation = np.sqrt(surface.fields[sd] ** 2 + unlikely * gap**2)
    return replace(surface, fields={**surface.fields, sd: deviation})


def absent(gap: Array, between: float, gradient: float, settings: ReconstructionSettings) -> Array:
    """Probability (v,) that there is no wall where the nearest point is `gap` (v,) away, of points that are
    `between` apart. Before points are seen it is larger for another heart's prior, which the rms gradient of
    the motion tells.

    On a wall that was visited so large a circle is empty with the probability of a Poisson process, on the
    part of the wall that was not visited always.
    """
    hearts = [settings.surplus.own, settings.surplus.another]
    shares = np.log([settings.absent, settings.absent_of_another])
    share = np.exp(np.interp(gradient, hearts, shares))
    unmapped = float((gap > settings.unmapped * between).mean())
    empty = unmapped + (1.0 - unmapped) * np.exp(-np.pi * (gap / between) ** 2)
    return np.asarray(share / (share + (1.0 - share) * empty))


@njit(cache=True, nogil=True)
def _told(vertices, near, told, feet, amplitude, variance, lengths):  # type: ignore[no-untyped-def]
    """Fill in the part (v,) of the field's variance at each vertex that points near it take away, by the
    Cholesky factor of their covariance.
    """
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
