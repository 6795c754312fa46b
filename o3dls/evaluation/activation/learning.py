"""How a map's activation times vary, and which of them are annotated wrongly, learnt from the map itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import cho_factor
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from ...arrays import Array
from .features import Features

UNKNOWN = 100.0  # variance of the constant, in squared scales
ROUNDS, JUDGED, STEPS = 3, 3, 12
WRONG = (0.005, 0.05, 0.3)  # share of wrong times: at least, to begin with, at most
LEAST_TRUST = 1e-3
KNOWN = 1e-3  # of a sd that is not learnt, the factor as below
# sds of the smooth part, the rough one and the noise over the scale, and by what factor (natural logarithm)
# they may well be others
BEGIN, MAY_VARY = (1.0, 0.25, 0.15), (0.7, 0.7, 0.8)


@dataclass(frozen=True, eq=False)
class Process:
    """A process has the sds of its smooth part, its rough part and the noise of one time, in ms; the weights
    (b,) of the features of the rough part's size; and how likely each time (k,) is no wrong annotation.
    """

    scale: float
    logs: Array
    trust: Array

    @property
    def smooth(self) -> float:
        return float(self.scale * np.exp(self.logs[0]))

    @property
    def noise(self) -> float:
        return float(self.scale * np.exp(self.logs[2]))

    def rough(self, features: Features) -> Array:
        """Return the sd (k,) of the rough part at places, in ms."""
        return np.asarray(self.scale * np.exp(self.logs[1] + features.local @ self.logs[3:]))

    def covariance(self, a: Features, b: Features) -> Array:
        """Return the covariance (k, l) of times at places, without noise."""
        found = self.smooth**2 * (a.smooth @ b.smooth.T)
        found += self.rough(a)[:, None] * (a.rough @ b.rough.T) * self.rough(b)
        return np.asarray(found + UNKNOWN * self.scale**2)

    def noises(self) -> Array:
        """Return the variance (k,) of the noise of each time."""
        return np.asarray(self.noise**2 / self.trust)


def learn_process(
    seen: Features, times: Array, scale: float, window: float, begin: Array | None = None
) -> Process:
    """Return the process that makes times (k,) likely, wrong ones given no weight. scale: what the times
    may vary by; window: what wrong ones lie in, both in ms. begin (3,): as `BEGIN`, with the smooth part's sd
    known.
    """
    may = np.array(MAY_VARY)
    if begin is not None:
        may[0] = KNOWN
    start = np.log(BEGIN if begin is None else begin)
    logs = np.append(start, np.zeros(seen.local.shape[1]))
    width = np.append(may, np.ones(len(logs) - 3))
    found = Process(scale, logs, np.ones(len(times)))
    likely = Likelihood(seen, times / scale, logs, width)
    wrong = WRONG[1]
    for _ in range(ROUNDS):
        how: Any = {"jac": True, "method": "L-BFGS-B", "options": {"maxiter": STEPS, "ftol": 1e-6}}
        asked = minimize(likely, found.logs, (found.trust,), **how)
        found = replace(found, logs=asked.x)
        for _ in range(JUDGED):
            missed, variance = leave_out(seen, times, found)
            right = (1.0 - wrong) * np.exp(-0.5 * missed**2 / variance) / np.sqrt(2.0 * np.pi * variance)
            trust = np.maximum(right / (right + wrong / window), LEAST_TRUST)
            wrong = float(np.clip(1.0 - trust.mean(), WRONG[0], WRONG[2]))
            found = replace(found, trust=trust)
    return found


def leave_out(seen: Features, times: Array, process: Process) -> tuple[Array, Array]:
    """Return by how much each time (k,) misses what the others tell of it, and the variance (k,) of that for
    a time that is no wrong annotation.
    """
    noises = process.noises()
    joint = process.covariance(seen, seen)
    joint[np.diag_indices_from(joint)] += noises
    inverse = _invert(joint)[0]
    alone = 1.0 / np.diag(inverse)
    return (inverse @ times) * alone, alone - noises + process.noise**2


@dataclass(frozen=True, eq=False)
class Likelihood:
    """A likelihood has times (k,) in scales, seen by features; called, it says how much they speak against a
    process, with the slope of that. logs are what the process is before, and width how far it may be off.
    """

    seen: Features
    times: Array
    logs: Array
    width: Array

    def __call__(self, logs: Array, trust: Array) -> tuple[float, Array]:
        process = Process(1.0, logs, trust)
        smooth = process.smooth**2 * (self.seen.smooth @ self.seen.smooth.T)
        size = process.rough(self.seen)
        rough = size[:, None] * (self.seen.rough @ self.seen.rough.T) * size
        noises = process.noises()
        joint = smooth + rough + UNKNOWN
        joint[np.diag_indices_from(joint)] += noises
        inverse, half = _invert(joint)
        answer = inverse @ self.times
        away = (logs - self.logs) / self.width
        value = 0.5 * float(self.times @ answer) + half + 0.5 * float(away @ away)
        # of the value by the covariance, times two
        steep = inverse - np.outer(answer, answer)
        by_size = (steep * rough).sum(axis=1)
        slope = away / self.width
        slope[:3] += (steep * smooth).sum(), by_size.sum(), np.diag(steep) @ noises
        slope[3:] += self.seen.local.T @ by_size
        return value, slope


def _invert(joint: Array) -> tuple[Array, float]:
    """Return the inverse (k, k) of a covariance, and half the logarithm of its determinant."""
    factor = cho_factor(joint, lower=True)[0]
    lower = np.tril(dpotri(factor, lower=1)[0])
    return lower + np.tril(lower, -1).T, float(np.log(np.diag(factor)).sum())
