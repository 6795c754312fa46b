"""Electrical values on a wall: what was measured at the points, taken from the nearest one that is near enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..case import Points
from ..geometry import Array, Surface
from ..transfer import REACH

UNITS = {"bipolar": "mV", "unipolar": "mV", "lat": "ms", "force": "g"}
FAR = REACH  # beyond it a point says nothing about the wall: there only the prior speaks, and no value is carried


def with_electrical(surface: Surface, points: Points) -> Surface:
    """The surface with each measured value taken from the nearest point within FAR; values that it carries already stay as they are."""
    from scipy.spatial import cKDTree

    fields = dict(surface.fields)
    for name, (xyz, values) in measured_values(points).items():
        if name not in fields:
            gap, nearest = cKDTree(xyz).query(surface.vertices)
            fields[name] = np.where(gap <= FAR, values[nearest], np.nan)
    return replace(surface, fields=fields)


def measured_values(points: Points) -> dict[str, tuple[Array, Array]]:
    """Positions and values of each electrical column of the eam points that is not empty."""
    eam = points.of("eam")
    found = {}
    for name in UNITS:
        values = eam.columns.get(name)
        if values is not None and values.dtype.kind == "f" and np.isfinite(values).any():
            known = np.isfinite(values)
            found[name] = (eam.xyz[known], np.asarray(values[known]))
    return found
