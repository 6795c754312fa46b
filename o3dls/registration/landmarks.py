"""Poses from named landmarks, and what the landmarks say about themselves: errors, mixed-up names, a mirrored side."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from ..geometry import Array, fit_similarity

NARROWEST = 0.05  # spread across the main line of the landmarks, relative to along it, below which a rotation is free
MUCH_BETTER = 0.5  # another reading of the names must halve the error before it is believed
NOTICEABLE = 0.1  # rms error relative to the landmarks' rms radius from which on other readings are tried
ALL_ORDERS = 6  # up to 720 orders are tried; of more landmarks only exchanges of two


@dataclass(frozen=True)
class Reading:
    """Another way to read the landmarks that fits much better: an exchange of names (old index per landmark), or a mirrored side."""

    rms: float
    order: tuple[int, ...] = ()

    @property
    def mirrored(self) -> bool:
        return not self.order


def errors(prior: Array, measured: Array, matrix: Array) -> Array:
    """Distances (n,) of the moved prior landmarks (n, d) from the measured ones."""
    return np.asarray(np.linalg.norm(prior @ matrix[:-1, :-1].T + matrix[:-1, -1] - measured, axis=1))


def leave_one_out(prior: Array, measured: Array, weights: Array, *, scale: bool) -> Array:
    """Error (n,) of each landmark under the fit to all others; NaN where the others fix no pose."""
    out = np.full(len(prior), np.nan)
    for i in range(len(prior)):
        others = np.arange(len(prior)) != i
        if determined(prior[others]) and determined(measured[others]):
            out[i] = errors(
                prior[i : i + 1], measured[i : i + 1], fit_similarity(prior[others], measured[others], weights[others], scale=scale)
            )[0]
    return out


def determined(points: Array) -> bool:
    """True where points (n, d) fix a rotation: not all on one line in 3D, not all in one place in 2D."""
    d = points.shape[1]
    if len(points) < d:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[0] > 0.0 and spread[d - 2] > NARROWEST * spread[0])


def better_reading(prior: Array, measured: Array, weights: Array, *, scale: bool) -> Reading | None:
    """The exchange of names, or the mirrored side, under which the landmarks fit much better than as named; None where there is none."""
    rms = _rms(prior, measured, weights, scale=scale)
    if rms < NOTICEABLE * np.sqrt(measured.var(axis=0).sum()):
        return None
    readings = [Reading(_rms(prior[list(o)], measured, weights, scale=scale), o) for o in _orders(len(prior))]
    mirror = np.ones(prior.shape[1])
    mirror[0] = -1.0
    readings.append(Reading(_rms(prior * mirror, measured, weights, scale=scale)))
    best = min(readings, key=lambda reading: reading.rms)
    return best if best.rms < MUCH_BETTER * rms else None


def _rms(prior: Array, measured: Array, weights: Array, *, scale: bool) -> float:
    distances = errors(prior, measured, fit_similarity(prior, measured, weights, scale=scale))
    return float(np.sqrt(weights @ distances**2 / weights.sum()))


def _orders(n: int) -> list[tuple[int, ...]]:
    if n <= ALL_ORDERS:
        return list(permutations(range(n)))[1:]
    swapped = []
    for i, j in combinations(range(n), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        swapped.append(tuple(order))
    return swapped
