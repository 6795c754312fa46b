"""What changed between the values of two maps on one prior.

With places r of the prior and values y_A, y_B of the maps,

    y_A = m + g(r) + e,     y_B = m + c + g(r) + d(r) + e:

g is what both maps see, c a difference that is the same everywhere (electrodes, gain), d the change. g and d
are Gaussian processes. e has the noise of a value, measured as what a map's neighbours do not tell of it, and
what errors of place make of the slope of the values, whose covariance follows from samples of both motions.
So d has a posterior, and what it seems to be where nothing changed can be drawn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtri

from ...arrays import Array, Mask
from ...errors import InputError
from ...geometry.surface import Surface
from ..interpolation import REACH
from ..measures.intervals import LEVEL
from .joint_maps import JointMaps
from .map_values import MapValues
from .regions import ChangedRegion, find_regions, redraw_regions

DRAWS = 400
# a map says nothing of wall that is farther than so many times its points are apart, or `REACH`; but so many
# mm are never too far
SPACINGS, NEAR = 1.2, 5.0


@dataclass(frozen=True, eq=False)
class ValueChange:
    """A value change has where (n,) both maps have points, and the regions that changed; the values (n,) of
    both maps and the change with its interval, in the unit of the column, NaN where they are not compared;
    and what differs everywhere with its interval (3,), a ratio or a difference, which `after` and `change`
    are free of.
    """

    compared: Mask
    regions: list[ChangedRegion]
    before: Array
    after: Array
    change: Array
    low: Array
    high: Array
    everywhere: Array

    @property
    def changed(self) -> Array:
        """The number (n,) of the region that a vertex is in, from 1; 0 in none, NaN where it is not known."""
        found = np.where(self.compared, 0.0, np.nan)
        for k, region in enumerate(self.regions, 1):
            found[region.inside] = k
        return found


def compare_values(
    prior: Surface, shown: Surface, maps: tuple[MapValues, MapValues], wall: Mask, *, ratio: bool, seed: int
) -> ValueChange:
    """Compare the values of two maps, which are logarithms where they are compared by their ratio, on the
    wall (n,) that both have points on. shown: the prior as it lies in the map whose areas are meant. Raises
    InputError where there is no such wall.
    """
    compared = wall & _find_known(prior, maps[0]) & _find_known(prior, maps[1])
    if not compared[prior.faces].all(axis=1).any():
        raise InputError("no part of the wall has points of both maps: they must map the same wall")
    joint = JointMaps.of(prior, maps, seed)
    rng = np.random.default_rng((seed, 3))
    mean, covariance = joint.posterior()
    errors = joint.errors_without_change(DRAWS, rng)
    overall, usual, regions = _part_overall(shown, mean[1], errors, compared)
    mean += np.array([[joint.middle], [-overall]])
    errors -= usual[:, None]
    regions = redraw_regions(shown, regions, mean[1], errors, compared, joint.differences(overall))
    everywhere = overall + usual.std() * np.array([0.0, -1.0, 1.0]) * ndtri((1.0 + LEVEL) / 2.0)
    rows = _in_unit(mean, covariance, ratio, rng)
    before, after, change, low, high = (np.where(compared, one, np.nan) for one in rows)
    everywhere = np.exp(everywhere) if ratio else everywhere
    return ValueChange(compared, regions, before, after, change, low, high, everywhere)


def _part_overall(
    shown: Surface, differs: Array, errors: Array, compared: Mask
) -> tuple[float, Array, list[ChangedRegion]]:
    """Part by how much the second map differs (n,), with its errors (k, n), into what does everywhere, with
    its errors (k,), and the regions that changed: the median of the wall, then of the wall beside them.
    """
    beside = compared
    for last in (False, True):
        area = shown.vertex_areas * beside
        overall = _find_median(differs, area)
        usual = np.array([_find_median(one, area) for one in errors])
        regions = find_regions(shown, differs - overall, errors - usual[:, None], compared)
        beside = compared & ~np.any([np.zeros_like(compared), *(one.inside for one in regions)], axis=0)
        if last or not regions or not beside.any():
            break
    return overall, usual, regions


def _find_known(prior: Surface, one: MapValues) -> Mask:
    """Return the vertices (n,) that points of a map are near to."""
    gap = cKDTree(one.at(prior, prior.vertices)).query(prior.vertices)[0]
    spacing = np.sqrt(float(prior.vertex_areas @ (gap <= REACH)) / len(one.values))
    return np.asarray(gap <= min(REACH, max(NEAR, SPACINGS * spacing)))


def _find_median(values: Array, weights: Array) -> float:
    """Return the median of values (n,), each as often as its weight (n,) says."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def _in_unit(mean: Array, covariance: Array, ratio: bool, rng: np.random.Generator) -> list[Array]:
    """Return values before and after, the change, and the interval of it (n,) in the unit of the column."""
    seen, change = mean
    sd = np.sqrt(np.maximum(covariance[[0, 1], [0, 1]], 0.0))
    if not ratio:
        half = ndtri((1.0 + LEVEL) / 2.0) * sd[1]
        return [seen, seen + change, change, change - half, change + half]
    # exp(seen) (exp(change) - 1), of two numbers that go together: drawn
    shared = covariance[0, 1] / np.maximum(sd[1], 1e-12)
    alone = np.sqrt(np.maximum(sd[0] ** 2 - shared**2, 0.0))
    first, second = rng.standard_normal((2, DRAWS, 1))
    drawn = np.exp(seen + alone * first + shared * second) * np.expm1(change + sd[1] * second)
    low, high = np.quantile(drawn, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0], axis=0)
    before = np.exp(seen)
    return [before, before * np.exp(change), before * np.expm1(change), low, high]
