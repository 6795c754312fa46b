"""Errors of points that go together: offsets of the map that change along the order of the points.

An array of electrodes takes a group of points with one offset; breathing and the pressure of the catheter
last for many points. Each of several offsets o_l is a vector that lives on the order t of the points,
independent along the axes:

    cov[n_i . o_l(t_i), n_j . o_l(t_j)] = tau_l^2 (n_i . n_j) exp(-|t_i - t_j| / l)

These are added to the covariance of the measurements, not to that of the motion. Points of one row are taken
one soon after the other: they share the offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Ints
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


def grams(directions: Array, taken: Taken, lengths: tuple[float, ...]) -> tuple[Array, ...]:
    """Return, for each length, the covariance (k, k) of the rows' offsets of unit deviation along directions
    (k, d); rows behind those that were `taken` are landmarks, which have none.
    """
    count = len(taken.at)
    dots = directions[:count] @ directions[:count].T
    more = (0, len(directions) - count)
    return tuple(np.pad(dots * taken.correlation(taken.at, length), more) for length in lengths)


@dataclass(frozen=True, eq=False)
class Drift:
    """A drift has the deviations of offsets, one for each of the settings' lengths, what saw them along
    directions (k, d), and the posterior of that.
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
        together = sum(
            sd**2 * self.taken.correlation(self.taken.place[some], length)
            for length, sd in zip(self.settings.lengths, self.sds, strict=True)
        )
        mean = together.T @ (self.solved.alpha[:count, None] * seen)
        crossed = np.zeros((len(self.directions), together.shape[1]))
        crossed[:count] = together * (seen @ seen[self.taken.row[some]].T)
        explained = self.solved.whitened(crossed)
        left = (self.sds**2).sum() - np.einsum("nk,nk->n", explained, explained)
        return mean, np.maximum(left, 0.0)
