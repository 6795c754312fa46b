"""Two maps of one prior as one Gaussian: what both see, what differs everywhere, and what changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from ...arrays import Array
from ...geometry.surface import Surface
from ..measures.numbers import slopes
from .map_values import MapValues
from .reach import CHANGE_LENGTH, Differences
from .value_process import UNKNOWN, ValueProcess, decay, learn_process, places

CHANGE_SD = 1.7  # of a change, over the sd of the values
NEIGHBOURS = 8  # points by which it is judged whether a place is noisier than the rest


@dataclass(frozen=True, eq=False)
class JointMaps:
    """Joint maps have the values (k,) of both maps less their `middle`, at places (k, 6); `second` (k,) is 1
    for those of the second map. `own` (k, k) is the covariance of what they have without what differs
    everywhere and without a change, noise among it.
    """

    prior: Surface
    process: ValueProcess
    at: Array
    middle: float
    values: Array
    second: Array
    own: Array

    @classmethod
    def of(cls, prior: Surface, maps: Sequence[MapValues], seed: int) -> JointMaps:
        """Learn how values vary, and how far errors of place and noise go."""
        normals = prior.vertex_normals
        at = [places(one.at(prior, prior.vertices), one.at(prior, normals)) for one in maps]
        process = learn_process(
            [(where, one.values, one.count) for where, one in zip(at, maps, strict=True)], seed
        )
        both = np.vstack(at)
        own = process.covariance(both, both)
        first = len(at[0])
        for rows, where, one in zip((slice(first), slice(first, None)), at, maps, strict=True):
            own[rows, rows] += _misplaced(prior, process, where, one)
        noise = np.concatenate([process.noise**2 / one.count for one in maps])
        own[np.diag_indices_from(own)] += np.maximum(noise, 1e-8 * max(process.sd**2, 1e-300))
        values = np.concatenate([one.values for one in maps])
        second = np.repeat([0.0, 1.0], [first, len(both) - first])
        middle = float(values.mean())
        found = cls(prior, process, both, middle, values - middle, second, own)
        own[np.diag_indices_from(own)] += found._unexpected()
        return found

    def posterior(self) -> tuple[Array, Array]:
        """Return the means (2, n) at the vertices of what the first map sees and of by how much the second
        differs from it, and their covariances (2, 2, n).
        """
        seen, differs = self._white
        answer = self._whiten(self.values)
        sd = self.process.sd
        variance = np.array([sd**2, (CHANGE_SD * sd) ** 2]) + UNKNOWN * sd**2
        covariance = -np.einsum("akn,bkn->abn", self._white, self._white)
        covariance[[0, 1], [0, 1]] += variance[:, None]
        return np.stack([seen.T @ answer, differs.T @ answer]), covariance

    def differences(self, overall: float) -> Differences:
        """Return by how much points of the second map differ from what the first tells of them, beside what
        differs everywhere.
        """
        second = self.second > 0.0
        wide = UNKNOWN * self.process.sd**2
        crossed = self.process.covariance(self.at[~second], self.at[second]) + wide
        told = cho_solve(cho_factor(self.own[np.ix_(~second, ~second)] + wide, lower=True), crossed)
        value = self.values[second] - told.T @ self.values[~second] - overall
        variance = np.diag(self.own)[second] + wide - (crossed * told).sum(axis=0)
        wall = places(self.prior.vertices, self.prior.vertex_normals)
        return Differences(wall, self.at[second], value, np.maximum(variance, 1e-8 * wide))

    def errors_without_change(self, count: int, rng: np.random.Generator) -> Array:
        """Return by how much (count, n) the second map seems to differ where it does not."""
        drawn = np.linalg.cholesky(self.own) @ rng.standard_normal((len(self.values), count))
        return np.asarray(self._whiten(drawn).T @ self._white[1])

    @cached_property
    def _factor(self) -> Array:
        """The Cholesky factor (k, k) of the covariance of the values."""
        sd = self.process.sd
        changed = (CHANGE_SD * sd) ** 2 * decay(cdist(self.at, self.at), CHANGE_LENGTH) + UNKNOWN * sd**2
        whole = self.own + UNKNOWN * sd**2 + changed * np.outer(self.second, self.second)
        return np.asarray(np.linalg.cholesky(whole))

    @cached_property
    def _white(self) -> Array:
        """Covariances (2, k, n) of the values with what is asked for at the vertices, whitened."""
        sd = self.process.sd
        asked = places(self.prior.vertices, self.prior.vertex_normals)
        distance = cdist(self.at, asked)
        seen = self.process.at_distance(distance) + UNKNOWN * sd**2
        differs = (CHANGE_SD * sd) ** 2 * decay(distance, CHANGE_LENGTH) + UNKNOWN * sd**2
        return np.stack([self._whiten(seen), self._whiten(differs * self.second[:, None])])

    def _whiten(self, values: Array) -> Array:
        return np.asarray(solve_triangular(self._factor, values, lower=True))

    def _unexpected(self) -> Array:
        """Return the variance (k,) that places have beyond what is expected there, as on the border of a
        scar: by how much points are farther from what the others tell of them than they should be.
        """
        inverse = solve_triangular(self._factor, np.eye(len(self.values)), lower=True)
        precision = (inverse**2).sum(axis=0)
        squared = (inverse.T @ self._whiten(self.values)) ** 2 / precision
        count = min(NEIGHBOURS, len(squared))
        near = cKDTree(self.at).query(self.at, k=np.arange(1, count + 1))[1]
        self.__dict__.pop("_factor")  # it is of the covariance as it was
        return np.asarray((np.maximum(squared[near].mean(axis=1), 1.0) - 1.0) / precision)


def _misplaced(prior: Surface, process: ValueProcess, at: Array, one: MapValues) -> Array:
    """Return the covariance (k, k) of what the error of place makes of the values of a map."""
    joint = process.covariance(at, at) + UNKNOWN * process.sd**2
    joint[np.diag_indices_from(joint)] += np.maximum(process.noise**2 / one.count, 1e-8 * process.sd**2)
    centred = one.values - one.values.mean()
    asked = places(prior.vertices, prior.vertex_normals)
    mean = (process.covariance(asked, at) + UNKNOWN * process.sd**2) @ np.linalg.solve(joint, centred)
    slope = one.at(prior, slopes(prior, mean))
    errors = one.at(prior, np.moveaxis(one.errors, 0, 1))
    missed = np.einsum("kd,ksd->sk", slope, errors)
    return np.asarray(missed.T @ missed / len(missed))
