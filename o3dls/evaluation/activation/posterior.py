"""What a map tells of the activation times of the wall: their mean, deviation, slope, and joint samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from ...arrays import Array, Ints
from .features import Features
from .harmonics import Harmonics
from .learning import UNKNOWN, Process

LEAST = 1e-6  # ms²/mm², of the variance of a slope


@dataclass(frozen=True, eq=False)
class TimePosterior:
    """A posterior of times has the process, the features of its points and of the vertices, the times (k,)
    at the points, and the covariance (k, k) that errors of place add to them.
    """

    harmonics: Harmonics
    process: Process
    seen: Features
    asked: Features
    times: Array
    misplaced: Array

    @property
    def mean(self) -> Array:
        """Mean (n,) of the times at the vertices, in ms."""
        return np.asarray(self._cross @ self._answer)

    @cached_property
    def sd(self) -> Array:
        """Standard deviation (n,) of the times at the vertices, in ms."""
        process, asked = self.process, self.asked
        prior = process.smooth**2 * (asked.smooth**2).sum(axis=1) + UNKNOWN * process.scale**2
        prior += process.rough(asked) ** 2 * (asked.rough**2).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(prior - (self._whiten(self._cross.T) ** 2).sum(axis=0), 0.0)))

    def slopes(self, at: Ints | None = None) -> tuple[Array, Array]:
        """Return the mean (k, 2) of the slope at vertices (k,), or at all, along the frames of the harmonics,
        in ms per mm, and its covariance (k, 2, 2).
        """
        process, harmonics = self.process, self.harmonics
        cross = harmonics.slopes(self._cross, at)
        white = np.stack([self._whiten(one.T) for one in cross])
        smooth = process.smooth * harmonics.slopes(self.asked.smooth, at)
        rough = harmonics.slopes(process.rough(self.asked)[:, None] * self.asked.rough, at)
        covariance = np.einsum("anm,bnm->nab", smooth, smooth) + np.einsum("anm,bnm->nab", rough, rough)
        covariance -= np.einsum("akn,bkn->nab", white, white)
        return (cross @ self._answer).T, covariance + LEAST * np.eye(2)

    def samples(self, count: int, rng: np.random.Generator) -> Array:
        """Return joint samples (count, n) of the times at the vertices: a draw of the process, set right by
        what its own points tell against the map's (Matheron's rule).
        """
        process, k = self.process, len(self.times)
        smooth = process.smooth * rng.standard_normal((self.asked.smooth.shape[1], count))
        rough = rng.standard_normal((self.asked.rough.shape[1], count))
        at_points = self.seen.smooth @ smooth + process.rough(self.seen)[:, None] * (self.seen.rough @ rough)
        at_points += np.linalg.cholesky(self._noise) @ rng.standard_normal((k, count))
        drawn = self.asked.smooth @ smooth + process.rough(self.asked)[:, None] * (self.asked.rough @ rough)
        missed = self._whiten(self.times[:, None] - at_points)
        return np.asarray((drawn + self._whiten(self._cross.T).T @ missed).T)

    @cached_property
    def _noise(self) -> Array:
        found = self.misplaced.copy()
        found[np.diag_indices_from(found)] += self.process.noises()
        return found

    @cached_property
    def _factor(self) -> Array:
        return np.asarray(np.linalg.cholesky(self.process.covariance(self.seen, self.seen) + self._noise))

    @cached_property
    def _cross(self) -> Array:
        """Covariance (n, k) of the times at the vertices with those at the points."""
        return self.process.covariance(self.asked, self.seen)

    @cached_property
    def _answer(self) -> Array:
        return np.asarray(solve_triangular(self._factor, self._whiten(self.times), lower=True, trans="T"))

    def _whiten(self, values: Array) -> Array:
        return np.asarray(solve_triangular(self._factor, values, lower=True))
