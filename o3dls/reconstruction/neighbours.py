"""The points nearest to places, and the seed of every choice at random."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from ..arrays import Array, Ints
from ..parallel import threads_for

SEED = 20_261_124


def nearest(points: Array, places: Array, count: int) -> tuple[Array, Ints]:
    """Return the distances (n, count) and rows (n, count) of the points nearest to places (n, 3), from near
    to far.
    """
    each = np.arange(1, count + 1)
    gap, rows = KDTree(points).query(places, k=each, workers=threads_for(len(places)))
    return np.asarray(gap), np.asarray(rows)
