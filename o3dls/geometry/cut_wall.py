"""The part of a surface that is no wall: where the border of its image cut the chamber off."""

from __future__ import annotations

import numpy as np

from ..arrays import Mask
from .surface import Surface

CUT = "cut_by_border"  # field of the vertices: 1 on a flat cap, between 0 and 1 where it was interpolated


def on_cut(surface: Surface) -> Mask:
    """Return the vertices (n,) where the border of the image cut the chamber off."""
    values = surface.fields.get(CUT)
    if values is None or values.ndim != 1:
        return np.zeros(len(surface.vertices), dtype=bool)
    return np.asarray(values > 0.5)
