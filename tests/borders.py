"""How straight a border is that two classes of a coarse mesh make along a plane, as one sees it."""

from __future__ import annotations

from typing import Any

import numpy as np

from o3dls.arrays import Array

SLOPE = 0.35  # of the border across the view from the front: no row of vertices lies along it


def above_border(vertices: Array) -> Any:
    """Say which vertices (n, 3) lie above a plane through their middle, which is seen as a line from -y."""
    offset = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return offset[:, 2] > SLOPE * offset[:, 0] + 0.7


def roughness(above: Any, within: Any) -> float:
    """Return how far, in pixels (root mean square), the border of a class (rows, columns) lies off a straight
    line in the middle columns of what is seen.
    """
    columns = np.flatnonzero(within.any(axis=0))
    middle = columns[len(columns) // 4 : -len(columns) // 4]
    rows = np.array([np.flatnonzero(within[:, k] & above[:, k])[-1] for k in middle])
    line = np.polynomial.Polynomial.fit(middle, rows, 1)
    return float(np.sqrt(np.mean((rows - line(middle)) ** 2)))
