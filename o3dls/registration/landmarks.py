"""Poses from named landmarks, and what landmarks and points say about the names: exchanged ones, a mirrored
side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from ..arrays import Array
from ..geometry.similarity import apply, fit_similarity

NARROWEST = (
    0.05  # spread across the main line of the landmarks, relative to along it, below which a rotation is free
)
# rms error relative to the landmarks' rms radius from which on the landmarks alone may accuse the names
NOTICEABLE = 0.1
MUCH_BETTER = 0.5  # ... if another reading halves the error
AS_GOOD = 2.0  # a reading whose error is at most this many times that of the names is for the points to judge
CERTAIN = 0.99  # ... if they are this sure
# ... and their cost falls by this factor: right names under a large motion were seen at .69, exchanged ones
# at .34 to .63
BETTER_FIT = 0.6
ALL_ORDERS = 6  # up to 720 orders are tried; of more landmarks only exchanges of two


@dataclass(frozen=True, eq=False)
class Reading:
    """A reading is one way to read the landmarks: which old name each gets (`order`), whether the side is
    mirrored; the pose and its rms error.
    """

    order: tuple[int, ...]
    mirrored: bool
    T_map_prior: Array
    rms: float

    @property
    def exchanged(self) -> list[int]:
        """Indices of the landmarks whose names would change."""
        return [i for i, j in enumerate(self.order) if i != j]


def errors(prior: Array, measured: Array, matrix: Array) -> Array:
    """Return the distances (n,) of the moved prior landmarks (n, d) from the measured ones."""
    return np.asarray(np.linalg.norm(apply(matrix, prior) - measured, axis=1))


def leave_one_out(prior: Array, measured: Array, weights: Array, *, scale: bool) -> Array:
    """Return the error (n,) of each landmark under the fit to all others; NaN where the others fix no
    pose.
    """
    out = np.full(len(prior), np.nan)
    for i in range(len(prior)):
        rest = np.arange(len(prior)) != i
        if determined(prior[rest]) and determined(measured[rest]):
            matrix = fit_similarity(prior[rest], measured[rest], weights[rest], scale=scale)
            out[i] = errors(prior[[i]], measured[[i]], matrix)[0]
    return out


def determined(points: Array) -> bool:
    """Say whether points (n, d) fix a rotation: not all on one line in 3D, not all in one place in 2D."""
    d = points.shape[1]
    if len(points) < d:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[0] > 0.0 and spread[d - 2] > NARROWEST * spread[0])


def fix_a_pose(prior: Array, measured: Array) -> bool:
    """Return whether landmark pairs (k, d) fix a pose."""
    return len(prior) >= 3 and determined(prior) and determined(measured)


def readings(prior: Array, measured: Array, weights: Array, *, scale: bool) -> list[Reading]:
    """Yield every reading of landmarks (n, d), as named first."""
    orders = _list_orders(len(prior))
    found = []
    for mirrored in (False, True):
        flip = np.diag([-1.0 if mirrored else 1.0, *np.ones(prior.shape[1])])
        turned = apply(flip, prior)[np.array(orders)]
        matrices = fit_similarity(turned, measured, weights, scale=scale)
        moved = turned @ np.swapaxes(matrices[:, :-1, :-1], 1, 2) + matrices[:, None, :-1, -1]
        rms = np.sqrt(((moved - measured) ** 2).sum(axis=2) @ weights / weights.sum())
        found += [
            Reading(order, mirrored, matrix @ flip, float(one))
            for order, matrix, one in zip(orders, matrices, rms, strict=True)
        ]
    return found


def better_reading(
    found: list[Reading], radius: float, costs: Callable[[Reading], Array] | None, points: Array
) -> Reading | None:
    """Return the reading that should replace the names, None where they stand.

    Names fall where another reading halves the error of the landmarks, whose rms radius is `radius`, unless
    the points say no; or where the points are sure of a reading that fits the landmarks about as well: an
    atrium's ostia are nearly a rectangle, so that they alone cannot tell left from right. Two mistakes at
    once, a mirrored prior and exchanged names, are for points that are sure: three landmarks, which lie in a
    plane, hardly tell them from one. `costs` gives the points' costs (n,) of a reading's pose, None where
    points are too few.
    """
    from .global_pose import confidence  # here, because it brings numba

    named = found[0]
    closest = min(found, key=lambda reading: reading.rms)
    accused = named.rms > NOTICEABLE * radius and closest.rms < MUCH_BETTER * named.rms
    limit = max(AS_GOOD * closest.rms, MUCH_BETTER * named.rms) if accused else AS_GOOD * named.rms
    rivals = [reading for reading in found[1:] if reading.rms <= limit]
    if not rivals:
        return None
    if costs is None:
        return (
            min(rivals, key=lambda reading: (reading.mirrored, len(reading.exchanged), reading.rms))
            if accused
            else None
        )
    of_rivals = [costs(reading) for reading in rivals]
    of_named = costs(named)
    best = int(np.argmin([cost.mean() for cost in of_rivals]))
    gain = float(of_rivals[best].mean() / of_named.mean())
    sure = gain < BETTER_FIT and confidence(of_rivals[best], of_named, points) > CERTAIN
    twice = rivals[best].mirrored and bool(rivals[best].exchanged)
    return rivals[best] if sure or (accused and not twice and gain < 1.0) else None


def explaining_scale(prior: Array, measured: Array) -> float:
    """Return the factor that brings landmarks (n, d) of the prior to the measured ones where one factor for
    all explains what a rigid motion does not; 1 where none does.
    """
    weights = np.ones(len(prior))
    rigid, scaled = (fit_similarity(prior, measured, weights, scale=scale) for scale in (False, True))
    before, after = (float(np.sqrt((errors(prior, measured, T) ** 2).mean())) for T in (rigid, scaled))
    radius = float(np.sqrt(measured.var(axis=0).sum()))
    if before <= NOTICEABLE * radius or after >= MUCH_BETTER * before or after > NOTICEABLE * radius:
        return 1.0
    return float(abs(np.linalg.det(scaled[:-1, :-1])) ** (1.0 / prior.shape[1]))


def _list_orders(n: int) -> list[tuple[int, ...]]:
    """List the orders to try, the identity first."""
    if n <= ALL_ORDERS:
        return list(permutations(range(n)))
    orders = [list(range(n))]
    for i, j in combinations(range(n), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        orders.append(order)
    return [tuple(order) for order in orders]
