"""Errors of points that go together: offsets of the map that change along the order of the points.

An array of electrodes takes a group of points with one offset; breathing and the pressure of the catheter
last for many points. Each of several offsets o_l is a vector that lives on the order t of the points,
independent along the axes:

    cov[n_i . o_l(t_i), n_j . o_l(t_j)] = tau_l^2 (n_i . n_j) exp(-|t_i - t_j| / l)

A tip that presses moves the wall along its normal, whichever way that faces, so that an offset p_l may also
be along the normal:

    cov[|n_i| p_l(t_i), |n_j| p_l(t_j)] = tau_l^2 |n_i| |n_j| exp(-|t_i - t_j| / l)

These are added to the covariance of the measurements, not to that of the motion. Points of one row are taken
one soon after the other: they share the offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import TINY, Array, Ints
from ..drift_settings import DriftSettings
from .gaussian_process import Posterior


@dataclass(frozen=True, eq=False)
class Taken:
    """This says when rows were taken: the mean place (k,) of a row's points in the order of all, counted in
    points; and of each point its place (n,) and the row (n,) that it is in.
    """

    at: Array
    place: Array
    row: Ints

    def correlation(self, other: Array, length: float) -> Array:
        """Return the correlation (k, m) of the rows' offsets with those of others taken at places (m,)."""
        return np.asarray(np.exp(-np.abs(self.at[:, None] - other[None]) / length))


def grams(directions: Array, taken: Taken, settings: DriftSettings) -> tuple[Array, ...]:
    """Return the covariance (k, k) of the rows' offsets of unit deviation along directions (k, d), for each
    length of shifts and then of pressure; rows behind those that were `taken` are landmarks, which have none.
    """
    count = len(taken.at)
    seen = directions[:count]
    more = (0, len(directions) - count)
    return tuple(
        np.pad(along * taken.correlation(taken.at, length), more)
        for along, lengths in zip(_along(seen, seen), settings.kinds, strict=True)
        for length in lengths
    )


def _along(seen: Array, others: Array) -> tuple[Array, Array]:
    """Return how alike shifts (k, m) and pressure (k, m) are, seen along directions (k, d) and (m, d)."""
    size, of_others = np.linalg.norm(seen, axis=1), np.linalg.norm(others, axis=1)
    return seen @ others.T, size[:, None] * of_others


@dataclass(frozen=True, eq=False)
class Drift:
    """A drift has the deviations of offsets, one for each of the settings' shifts and pressures, what saw
    them along directions (k, d), and the posterior of that.
    """

    settings: DriftSettings
    sds: Array
    taken: Taken
    directions: Array
    solved: Posterior

    def offsets(self) -> tuple[Array, Array]:
        """Return the expected offset (n, d) of each point, and how much of its variance along the wall's
        normal (n,) is left: K*' (K + S)^-1 z, and K** less what is explained.
        """
        count, step = len(self.taken.place), self.settings.at_once
        parts = [slice(k, k + step) for k in range(0, count, step)]
        means, variances = zip(*(self._offsets_of(part) for part in parts), strict=True)
        return np.concatenate(means), np.concatenate(variances)

    def _offsets_of(self, some: slice) -> tuple[Array, Array]:
        count = len(self.taken.at)
        seen = self.directions[:count]
        facing = seen[self.taken.row[some]]
        place = self.taken.place[some]
        parts = np.split(self.sds, [len(self.settings.shifts)])
        kinds = zip(self.settings.kinds, parts, strict=True)
        shift, pressure = (self._covariance(place, lengths, sds) for lengths, sds in kinds)
        alpha, size = self.solved.alpha[:count], np.linalg.norm(seen, axis=1)
        outward = facing / np.maximum(np.linalg.norm(facing, axis=1), TINY)[:, None]
        mean = shift.T @ (alpha[:, None] * seen) + (pressure.T @ (alpha * size))[:, None] * outward
        of_shift, of_pressure = _along(seen, facing)
        crossed = np.zeros((len(self.directions), len(place)))
        crossed[:count] = shift * of_shift + pressure * of_pressure
        explained = self.solved.whitened(crossed)
        left = (self.sds**2).sum() - np.einsum("nk,nk->n", explained, explained)
        return mean, np.maximum(left, 0.0)

    def _covariance(self, place: Array, lengths: tuple[float, ...], sds: Array) -> Array:
        """Return the covariance (k, m) of offsets of one kind, of the rows' with those at places (m,)."""
        found = np.zeros((len(self.taken.at), len(place)))
        for length, sd in zip(lengths, sds, strict=True):
            found += sd**2 * self.taken.correlation(place, length)
        return found
