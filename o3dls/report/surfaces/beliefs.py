"""How likely each point of a run touches the wall, by what an estimate made of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import Array
from ...runs.run import Run

BELIEVED = 0.5  # weights below mark a point as outlier


def beliefs(run: Run, key: str) -> Array:
    """Return the weight (n,) of each point of the run, which says how likely it touches the wall of an
    estimate; NaN where it has none.
    """
    weights = run.estimates[key].weights
    kinds = run.points.type
    found = np.full(len(kinds), np.nan)
    choices: Sequence[tuple[str, ...]] = (("eam",), ("eam", "inside"))
    for fitted in choices if weights is not None else ():
        rows = np.flatnonzero(np.isin(kinds, fitted))
        if weights is not None and len(weights) == len(rows):
            found[rows] = weights
            return found
    return found
