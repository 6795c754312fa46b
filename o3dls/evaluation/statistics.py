"""How sure a number is: bands of a deviation, and differences, paired and resampled in spatial blocks, since
neighbouring points err together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..arrays import Array, Ints

ROUNDS = 4000
FEWEST_BLOCKS, MOST_BLOCKS, PER_BLOCK = 8, 60, 5
SEED = 74215
DEGREES = 8.0  # of freedom of errors over their deviations
BAND_68, BAND_95 = 0.901126, 1.959964  # band(0.68) and band(0.95)


def band(share: float, dimensions: int = 1) -> float:
    """Return how many deviations hold this share of the errors: half the width of a band, or the half axes of
    an ellipsoid in as many dimensions.

    The deviation of a fit takes the amplitudes and the noise that it found as known, so that errors are as a
    deviation that is itself uncertain makes them. They follow Student's t, scaled so that 95 % of those in
    one dimension are within the 1.96 deviations of a Gaussian.
    """
    from scipy.special import fdtri, ndtri

    scale = ndtri(0.975) ** 2 / fdtri(1, DEGREES, 0.95)
    return float(np.sqrt(scale * dimensions * fdtri(dimensions, DEGREES, share)))


@dataclass(frozen=True)
class Difference:
    """A difference is the mean of `second - first` over the same points (negative: the second is closer),
    with its 95 % interval and what it rests on.

    The interval is NaN where there are too few points to resample in blocks.
    """

    first: float
    second: float
    mean: float
    low: float
    high: float
    n: int
    blocks: int

    @property
    def percent(self) -> float:
        return 100.0 * self.mean / self.first if self.first else 0.0

    @property
    def clear(self) -> bool:
        """True where the interval leaves out zero."""
        return self.low > 0 or self.high < 0


def paired_difference(first: Array, second: Array, positions: Array) -> Difference:
    """Return the difference of two distances (n,) measured at the same positions (n, d), with a block
    bootstrap interval.
    """
    change = second - first
    labels = spatial_blocks(positions)
    sums = np.bincount(labels, change)
    counts = np.bincount(labels)
    drawn = _draw_blocks(len(counts))
    enough = len(counts) >= FEWEST_BLOCKS
    low, high = np.percentile((drawn @ sums) / (drawn @ counts), [2.5, 97.5]) if enough else (np.nan, np.nan)
    return Difference(
        float(first.mean()),
        float(second.mean()),
        float(change.mean()),
        float(low),
        float(high),
        len(change),
        len(counts),
    )


@lru_cache(maxsize=8)  # a page has some thirty differences, most of them of MOST_BLOCKS blocks
def _draw_blocks(blocks: int) -> Ints:
    """Return how often (ROUNDS, blocks) each block is drawn in each round."""
    rng = np.random.default_rng(SEED)
    return rng.multinomial(blocks, np.full(blocks, 1 / blocks), size=ROUNDS)


def difference_over_cases(differences: Sequence[Difference]) -> Difference:
    """Return the mean of the differences of several cases, each of one weight, with Student's interval; NaN
    for one.

    Cohorts are small, and an interval from resampling a few cases is too narrow (of five it holds the truth
    in about 84 of 100).
    """
    from scipy.special import stdtrit

    change = np.array([one.mean for one in differences])
    n = len(change)
    half = stdtrit(n - 1, 0.975) * change.std(ddof=1) / np.sqrt(n) if n > 1 else np.nan
    first, second = (
        float(np.mean([getattr(one, end) for one in differences])) for end in ("first", "second")
    )
    mean = float(change.mean())
    return Difference(first, second, mean, float(mean - half), float(mean + half), n, n)


def spatial_blocks(positions: Array) -> Ints:
    """Return the block number (n,) of each point: up to 60 blocks of some 5 points (2 where points are few),
    around points far from one another.
    """
    return _divide_into_blocks(positions.tobytes(), positions.shape[1], positions.dtype.str)


@lru_cache(maxsize=16)  # estimates are compared at the same points
def _divide_into_blocks(data: bytes, dimension: int, kind: str) -> Ints:
    positions = np.frombuffer(data, dtype=kind).reshape(-1, dimension)
    count = max(1, min(len(positions) // 2, max(FEWEST_BLOCKS, len(positions) // PER_BLOCK), MOST_BLOCKS))
    nearest = np.full(len(positions), np.inf)
    labels = np.zeros(len(positions), dtype=np.int64)
    centre = int(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).argmax())
    for block in range(count):
        gap = ((positions - positions[centre]) ** 2).sum(axis=1)
        labels[gap < nearest] = block
        nearest = np.minimum(nearest, gap)
        centre = int(nearest.argmax())
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)
