"""Electrical values of the points, brought to a surface."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..case import Points
from ..geometry.surface import Surface
from .interpolation import REACH, to_surface
from .projection import project

# columns and their units
ELECTRICAL = {
    "bipolar": "mV",
    "unipolar": "mV",
    "lat": "ms",
    "force": "g",
    "impedance": "ohm",
}


def with_electrical(
    surface: Surface, points: Points, *, columns: Collection[str] = tuple(ELECTRICAL)
) -> Surface:
    """Return the surface with each of these columns that the eam points carry, NaN where no value is near."""
    fields = dict(surface.fields)
    for name, (xyz, values) in measured_values(points, columns).items():
        near = (project(xyz, surface).distance <= REACH).any()
        fields[name] = to_surface(xyz, values, surface) if near else np.full(len(surface.vertices), np.nan)
    return replace(surface, fields=fields)


def measured_values(
    points: Points, columns: Collection[str] = tuple(ELECTRICAL)
) -> dict[str, tuple[Array, Array]]:
    """Return positions (k, d) and values (k,) of each of these columns of the eam points that holds any
    number.
    """
    eam = points.of("eam")
    found = dict[str, tuple[Array, Array]]()
    for name in columns:
        values = eam.columns.get(name)
        if values is not None and values.dtype.kind in "fiu" and np.isfinite(values).any():
            known = np.isfinite(values)
            found[name] = (eam.xyz[known], np.asarray(values[known], dtype=np.float64))
    return found
