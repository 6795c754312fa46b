"""The mean of a value over several hearts, and how hearts differ, by atrial coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Ints
from .coordinates import AtrialCoordinates, carry_field
from .division import SEGMENTS, VALVE

LEAST = 0.5  # share of a segment that must be mapped for its mean to count
LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class HeartMap:
    """A heart's map has the name of the heart, its atrial coordinates, the segment (n,) of each vertex, and a
    value (n,), NaN where nothing was measured.
    """

    name: str
    coordinates: AtrialCoordinates
    segment: Ints
    values: Array


@dataclass(frozen=True, eq=False)
class MeanMap:
    """A mean map has, per vertex (m,) of the atrium that it lies on, the mean over hearts, their standard
    deviation and the number of hearts that are known there: NaN for a mean of none, and for a deviation of
    fewer than two.
    """

    mean: Array
    spread: Array
    hearts: Ints


@dataclass(frozen=True)
class SegmentMean:
    """A segment has the mean over `hearts` hearts, its 95 % interval and the standard deviation between
    hearts; NaN for what so few hearts do not tell.
    """

    segment: int
    name: str
    hearts: int
    mean: float
    low: float
    high: float
    spread: float


def average_maps(maps: Sequence[HeartMap], on: AtrialCoordinates) -> MeanMap:
    """Lay the maps on an atrium by their coordinates, and average them at each of its vertices."""
    laid = np.array([carry_field(one.values, one.coordinates, on) for one in maps])
    known = np.isfinite(laid)
    hearts = known.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(known, laid, 0.0).sum(axis=0) / hearts
        squares = np.where(known, (laid - mean) ** 2, 0.0).sum(axis=0)
        spread = np.sqrt(squares / np.where(hearts > 1, hearts - 1, np.nan))
    return MeanMap(mean, spread, hearts)


def average_segments(maps: Sequence[HeartMap]) -> list[SegmentMean]:
    """Average the means of each segment, which each heart has of its own map and by its own borders.

    A heart counts where at least half of the segment is mapped. Intervals are Student's, of the mean over the
    hearts from which these are a sample.
    """
    from scipy.stats import t as student

    found = []
    for k, name in SEGMENTS.items():
        if k == VALVE:
            continue
        means = np.array([one for one in (_average_segment(heart, k) for heart in maps) if one is not None])
        n = len(means)
        mean = float(means.mean()) if n else np.nan
        spread = float(means.std(ddof=1)) if n > 1 else np.nan
        half = float(student.ppf(0.5 + 0.5 * LEVEL, n - 1)) * spread / np.sqrt(n) if n > 1 else np.nan
        found.append(SegmentMean(k, name, n, mean, mean - half, mean + half, spread))
    return found


def _average_segment(heart: HeartMap, segment: int) -> float | None:
    """Return the mean by area over the mapped part of a segment; None where too little of it is mapped."""
    area = heart.coordinates.surface.vertex_areas * (heart.segment == segment)
    known = np.isfinite(heart.values)
    mapped = float(area[known].sum())
    if mapped <= LEAST * area.sum():
        return None
    return float(area[known] @ heart.values[known]) / mapped
