"""How far the wall may lie off the moved prior at each place: as predicts points best from neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import sparse

from ...arrays import Array, Ints
from ...motion.field.covariance import WORTH
from ...motion.field.kernels import NUGGET
from ...parallel import by_rows
from ..neighbours import SEED, nearest
from ..settings import AmplitudeSettings, ReconstructionSettings
from .equations import Oriented, off_prior, turned_off
from .moved_prior import MovedPrior
from .spline_fit import Scale
from .splines import correlation


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """Amplitudes are the deviation (n,) of the field before points are seen, at each of them; the factor on
    their noise that it goes with; and by how many nats it predicts points better than the moved prior alone,
    each with the noise that is best for it.
    """

    at: Array
    noise_factor: float
    gain: float


def amplitudes(
    wall: Oriented, prior: MovedPrior, scale: Scale, settings: ReconstructionSettings
) -> Amplitudes:
    """Choose, around each place, the amplitude of a ladder that predicts each point's distance from the moved
    prior best, given the distances of its neighbours.

    The likelihoods are those of Gaussian-process regression on nearest neighbours (Vecchia 1988), each point
    left out. Points off the prior have the largest.
    """
    chosen = settings.amplitude
    ladder = scale.radius * np.asarray(chosen.ladder)
    known = wall.of(~turned_off(wall, prior, settings.splines) & (wall.weights > 0.5))
    together = np.unique(known.stretch, return_counts=True)[1].max(initial=0)
    if len(known.feet) - together < chosen.neighbours:
        return Amplitudes(np.full(len(wall.feet), ladder[-1]), 1.0, 0.0)
    order = np.random.default_rng(SEED).permutation(len(known.feet))
    tested = np.sort(order[: chosen.most_points])
    weights = known.weights[tested]
    likely = _score_amplitudes(known, prior, tested, ladder, scale, settings)
    around = _weigh_neighbours(known.feet[tested], known.feet[tested], weights, scale, settings)
    shares = [_estimate_shares(around @ one, chosen) for one in np.moveaxis(likely, 2, 0)]
    totals = [
        float(weights @ (_amplitude_probabilities(around @ one, share) * one).sum(axis=1))
        for one, share in zip(np.moveaxis(likely, 2, 0), shares, strict=True)
    ]
    noise = int(np.argmax(totals))
    # the lowest amplitude stands for no deviation: the wall is the moved prior
    gain = (totals[noise] - float((weights @ likely[:, 0]).max())) * len(known.feet) / len(tested)
    around = _weigh_neighbours(wall.feet, known.feet[tested], weights, scale, settings)
    at = np.sqrt(_amplitude_probabilities(around @ likely[:, :, noise], shares[noise]) @ ladder**2)
    off = off_prior(wall, prior, settings.splines)
    return Amplitudes(np.where(off, ladder[-1], at), float(chosen.noise_factors[noise]), gain)


def _weigh_neighbours(
    places: Array, points: Array, weights: Array, scale: Scale, settings: ReconstructionSettings
) -> sparse.csr_matrix:
    """Return the matrix (n, m) of how much each of m points, with weights (m,), counts at n places (n, 3)."""
    chosen = settings.amplitude
    gap, who = nearest(points, places, min(chosen.around, len(points)))
    say = weights[who] * np.exp(-0.5 * (gap / (chosen.reach * scale.radius)) ** 2)
    pointer = np.arange(0, who.size + 1, who.shape[1])
    return sparse.csr_matrix((say.ravel(), who.ravel(), pointer), shape=(len(places), len(points)))


def _estimate_shares(local: Array, chosen: AmplitudeSettings) -> Array:
    """Estimate, by expectation maximisation, which shares (a,) of the places have each amplitude, from its
    likelihoods (n, a).
    """
    shares: Array = np.full(local.shape[1], 1.0 / local.shape[1])
    for _ in range(chosen.iterations):
        shares = np.maximum(_amplitude_probabilities(local, shares).mean(axis=0), chosen.least_share)
        shares /= shares.sum()
    return shares


def _amplitude_probabilities(local: Array, shares: Array) -> Array:
    """Return the probabilities (n, a) of the amplitudes from their log likelihoods (n, a) and shares (a,)."""
    log = local + np.log(shares)
    odds = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(odds / odds.sum(axis=1, keepdims=True))


class _Measured(NamedTuple):
    """Points have feet (m, 3) on the moved prior, signed distances from it (m,), and noise (m,)."""

    feet: Array
    values: Array
    noise: Array


def _score_amplitudes(
    known: Oriented,
    prior: MovedPrior,
    tested: Ints,
    ladder: Array,
    scale: Scale,
    settings: ReconstructionSettings,
) -> Array:
    """Return the log densities (k, amplitudes, noise factors) of the tested points, each given its
    neighbours.
    """
    chosen = settings.amplitude
    lengths = np.asarray(scale.lengths(known.noise, settings.splines))
    count = min(chosen.neighbours + 1, len(known.feet))
    # neighbours are sought on the moved prior: in space, points are near when their noise happens to agree
    points = known.points
    squared, _, feet, _ = prior.tree.query(points)
    distance = np.where(prior.at(points) < 0.0, -1.0, 1.0) * np.sqrt(squared)
    near = _find_neighbours(feet, known.stretch, tested, count)
    factors = np.asarray(chosen.noise_factors)
    out = np.zeros((len(tested), len(ladder), len(factors)))
    measured = _Measured(feet, distance, known.noise)
    by_rows(_fill_log_densities, WORTH, (near, out), measured, ladder, factors, lengths)
    return out


def _find_neighbours(feet: Array, stretch: Ints, tested: Ints, count: int) -> Ints:
    """Find the rows (k, count) of tested points and of the nearest that share no error with each."""
    taken = np.unique(stretch)
    if len(taken) == len(feet):
        return _itself_first(nearest(feet, feet[tested], count)[1], tested)
    near = np.empty((len(tested), count), dtype=np.int64)
    near[:, 0] = tested
    for one in taken:
        mine = stretch[tested] == one
        others = np.flatnonzero(stretch != one)
        near[mine, 1:] = others[nearest(feet[others], feet[tested[mine]], count - 1)[1]]
    return near


def _itself_first(near: Ints, own: Ints) -> Ints:
    """Find the rows (k, m) of the points nearest to points `own` (k,), which come first themselves: other
    points may coincide with them.
    """
    order = np.argsort(near != own[:, None], axis=1, kind="stable")
    near = np.take_along_axis(near, order, axis=1)
    near[:, 0] = own
    return near


@njit(cache=True, nogil=True)
def _fill_log_densities(near, out, measured, ladder, factors, lengths):  # type: ignore[no-untyped-def]
    """Fill in the log density of the first value of each row of `near` given the others, for every amplitude
    and factor on the noise.
    """
    feet, values, noise = measured
    count = near.shape[1]
    alike = np.empty((count, count))
    factor = np.empty((count, count))
    solved = np.empty(count)
    for row in range(len(near)):
        for i in range(count):
            for j in range(i + 1):
                alike[i, j] = correlation(feet[near[row, i]], feet[near[row, j]], lengths)
        for a in range(len(ladder)):
            for f in range(len(factors)):
                # by the Cholesky factor of the others' covariance, with the first value's row last
                mean = 0.0
                told = 0.0
                for i in range(1, count):
                    for j in range(1, i + 1):
                        entry = ladder[a] ** 2 * alike[i, j]
                        if i == j:
                            entry += (factors[f] * noise[near[row, i]]) ** 2 + NUGGET * ladder[a] ** 2
                        for k in range(1, j):
                            entry -= factor[i, k] * factor[j, k]
                        factor[i, j] = np.sqrt(entry) if i == j else entry / factor[j, j]
                    value = values[near[row, i]]
                    across = ladder[a] ** 2 * alike[i, 0]
                    for k in range(1, i):
                        value -= factor[i, k] * solved[k]
                        across -= factor[i, k] * factor[0, k]
                    solved[i] = value / factor[i, i]
                    factor[0, i] = across / factor[i, i]
                    mean += solved[i] * factor[0, i]
                    told += factor[0, i] ** 2
                own = near[row, 0]
                variance = ladder[a] ** 2 * alike[0, 0] - told + (factors[f] * noise[own]) ** 2
                left = values[own] - mean
                out[row, a, f] = -0.5 * (left * left / variance + np.log(2.0 * np.pi * variance))
