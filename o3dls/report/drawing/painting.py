"""What a wall is painted with, pixel by pixel, as the viewer paints it: borders of colours, of classes, of
hatching and of wall without a value lead through the triangles, not along them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from ...arrays import Array, Ints
from ...evaluation.interpolation import REACH
from ...geometry.surface import Surface
from .fields import Field, colours_of

if TYPE_CHECKING:
    from .raster import Pixels

Paint = Callable[["Pixels"], Array]

SOFTENED = 3  # rings of vertices over which shares change, as in static/borders.js
HATCH_ON_COLOUR, HATCH_ON_GREY = 0.72, 0.42  # wall without a value is grey itself


def plain(colour: tuple[float, float, float]) -> Paint:
    """Paint all of a wall in one colour."""
    return lambda pixels: np.tile(colour, (len(pixels.corners), 1))


def paint_field(surface: Surface, field: Field, remoteness: Array | None = None) -> Paint:
    """Paint a wall in the colours of a field, grey where it has no value, and hatched where no point is near,
    by the distance (n,) to the nearest in mm. A field with steps has one colour from line to line.

    A field of regions has in each pixel the colour of the region with the largest share there.
    """
    values = surface.fields.get(field.key, np.full(len(surface.vertices), np.nan))
    around = _mean_around(surface.faces, len(values))
    known = soften(around, np.isfinite(values).astype(np.float64))
    classes = soften(around, _indicate(values, len(field.names))) if field.names else None
    shade = _continue_values(around, values)
    far = np.zeros(len(values)) if remoteness is None else remoteness

    def paint(pixels: Pixels) -> Array:
        seen = pixels.read(shade) if classes is None else pixels.read(classes).argmax(axis=1)
        if field.step:
            seen = field.step * (np.floor(seen / field.step) + 0.5)
        bare = pixels.read(known) < 0.5
        colours = colours_of(np.where(bare, np.nan, seen), field)
        lined = pixels.striped & (pixels.read(far) > REACH)
        grey = np.where(bare, HATCH_ON_GREY, HATCH_ON_COLOUR)[lined, None]
        colours[lined] = 0.2 * colours[lined] + 0.8 * grey
        return colours

    return paint


def soften(around: sparse.csr_array, shares: Array) -> Array:
    """Return shares (n,) or (n, k) that go smoothly from 1 to 0 across the border of a class."""
    for _ in range(SOFTENED):
        shares = (shares + around @ shares) / 2
    return shares


def _indicate(values: Array, count: int) -> Array:
    """Return 1 for the class of each vertex, (n, count), 0 for all others."""
    return np.asarray(values[:, None] == np.arange(count), dtype=np.float64)


def _continue_values(around: sparse.csr_array, values: Array) -> Array:
    """Return the values (n,), and beyond their border the mean of the neighbours that have one."""
    for _ in range(SOFTENED):
        there = np.isfinite(values)
        if there.all():
            break
        weight = around @ there.astype(np.float64)
        near = np.where(
            weight > 0, (around @ np.nan_to_num(values)) / np.where(weight > 0, weight, 1.0), np.nan
        )
        values = np.where(there, values, near)
    return values


def _mean_around(faces: Ints, count: int) -> sparse.csr_array:
    """Return the matrix (n, n) that takes the mean of each vertex's neighbours."""
    starts = np.concatenate([faces.ravel(), faces.ravel()])
    ends = np.concatenate([faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()])
    edges = sparse.coo_array((np.ones(len(starts)), (starts, ends)), shape=(count, count)).tocsr()
    number = np.maximum(np.asarray(edges.sum(axis=1)), 1.0)
    return sparse.csr_array(sparse.diags_array(1.0 / number) @ edges)
