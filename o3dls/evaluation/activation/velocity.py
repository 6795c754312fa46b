"""How fast and which way a wave goes, from the slope of its times.

A process of times does not know that waves are neither infinitely fast nor still. So the speed's posterior is
what the map says of the slope, times what is known of speeds: log-normal, any direction. It corrects the bias
of one over the length of a noisy slope.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from scipy.special import ndtri

from ...arrays import Array, Ints, Mask

USUAL, SPREAD = 0.55, 0.55  # m/s, sd of the logarithm: half of all waves go at 0.38 to 0.8 m/s
SPEEDS = np.exp(np.linspace(np.log(0.05), np.log(4.0), 48))  # m/s that are tried
ANGLES = 2.0 * np.pi * np.arange(32) / 32
PHYSIOLOGICAL = 0.1, 2.0  # m/s
ALIGNED = 0.8  # length of the mean direction from which one is told
SURE = 3.5  # the interval's upper end over its lower one, up to which a speed is told
LEVEL = 0.95
BATCH = 1000  # vertices


class Told(IntEnum):
    """Why no velocity is told at a place, 0 where one is."""

    VELOCITY = 0
    FAR = 1  # no point is near, or there is no wall
    UNDIRECTED = 2  # waves start or meet there, or the slope cannot be told from none
    UNSURE = 3  # the interval is too wide
    STRANGE = 4  # slower or faster than waves of the heart are


@dataclass(frozen=True, eq=False)
class Velocity:
    """A velocity at places has the speed (n,) in m/s with its interval (n,), the direction (n, 2) along the
    frames of the harmonics, the length (n,) of its mean, and for which reason (n,) nothing is told (`Told`).
    """

    speed: Array
    low: Array
    high: Array
    direction: Array
    aligned: Array

    def tell(self, known: Mask) -> Ints:
        """Return `Told` (n,), as whole numbers. known (n,): where there is a map."""
        strange = (self.high < PHYSIOLOGICAL[0]) | (self.low > PHYSIOLOGICAL[1])
        strange |= (self.speed < PHYSIOLOGICAL[0]) | (self.speed > PHYSIOLOGICAL[1])
        # in the order of `Told`
        reasons: list[Any] = [~known, self.aligned < ALIGNED, self.high > SURE * self.low, strange]
        return np.asarray(np.select(reasons, [1, 2, 3, 4], 0))


def find_velocity(slope: Array, covariance: Array) -> Velocity:
    """Return the velocity at places with slopes (n, 2) in ms per mm and their covariance (n, 2, 2)."""
    parts = [_find_some(slope[k : k + BATCH], covariance[k : k + BATCH]) for k in range(0, len(slope), BATCH)]
    return Velocity(*(np.concatenate(one) for one in zip(*parts, strict=True)))


def _find_some(slope: Array, covariance: Array) -> tuple[Array, ...]:
    ways = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
    steep = 1.0 / SPEEDS
    precision = np.linalg.inv(covariance)
    # -2 log N(s u; slope, covariance) for a slowness s along a unit vector u
    straight = np.einsum("ta,nab,tb->nt", ways, precision, ways)
    along = np.einsum("ta,nab,nb->nt", ways, precision, slope)
    surprise = steep[:, None] ** 2 * straight[:, None] - 2.0 * steep[:, None] * along[:, None]
    surprise += ((np.log(SPEEDS / USUAL) / SPREAD) ** 2)[:, None]
    chance = np.exp(-0.5 * (surprise - surprise.min(axis=(1, 2), keepdims=True)))
    chance /= chance.sum(axis=(1, 2), keepdims=True)
    below = np.cumsum(chance.sum(axis=2), axis=1)
    below -= 0.5 * chance.sum(axis=2)
    log, ends = np.log(SPEEDS), (0.5, (1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0)
    speeds = np.exp([[np.interp(end, one, log) for one in below] for end in ends])
    mean = chance.sum(axis=1) @ ways
    aligned = np.linalg.norm(mean, axis=1)
    return *speeds, mean / np.maximum(aligned, 1e-12)[:, None], aligned


def sample_speeds(found: Velocity, slope: Array, covariance: Array, drawn: Array) -> Array:
    """Return joint samples (k, n) of the speeds, of whose slopes samples drawn (k, n, 2) are given: each has
    the quantile of its own posterior at which the slope along the direction of the wave lies.
    """
    variance = np.einsum("na,nab,nb->n", found.direction, covariance, found.direction)
    steeper = np.einsum("kna,na->kn", drawn - slope, found.direction) / np.sqrt(variance)
    half = ndtri((1.0 + LEVEL) / 2.0)
    up, down = np.log(found.high / found.speed) / half, np.log(found.speed / found.low) / half
    return np.asarray(found.speed * np.exp(-steeper * np.where(steeper < 0.0, up, down)))
