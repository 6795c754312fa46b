"""What a field of the wall is at the places of points, which are known with an error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Mask
from ...geometry.surface import Surface, interpolated
from ...motion.wall.samples import SurfaceSamples
from ..interpolation import REACH
from ..projection import project


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings are what a field of the wall is at n points: `naive` (n,) at the places nearest to them on the
    surface, `drawn` (k, n) where they may as well lie; NaN where the field is not known. at (n, 3): the
    nearest places; near (n,): which points lie within 10 mm of the wall.
    """

    naive: Array
    drawn: Array
    at: Array
    near: Mask

    def of(self, rows: Mask) -> Readings:
        """Those of some of the points (n,)."""
        return Readings(self.naive[rows], self.drawn[:, rows], self.at[rows], self.near[rows])


def read_at_points(
    samples: SurfaceSamples, field: Array, xyz: Array, noise: Array, rng: np.random.Generator
) -> Readings:
    """Read a field (v,) of the wall at points (n, 3) that were measured with a noise (n,) per axis, in mm.

    A point at x was taken on the wall at x - e, with e of the noise; where a sample moves the wall there by
    u, this is the place of the wall that the surface itself has at x - e - u. So the error of a reading holds
    that of the registration, which points share, and that of the point itself.
    """
    surface = samples.surface
    met = project(xyz, surface)
    corners = surface.faces[met.face]
    moved = samples.vertices[:, corners] - surface.vertices[corners]
    shift = np.einsum("kncd,nc->knd", moved, met.weights)
    shift += noise[:, None] * rng.standard_normal(shift.shape)
    drawn = _read_nearest(surface, field, (xyz - shift).reshape(-1, xyz.shape[1]))
    naive = interpolated(field, corners, met.weights)
    return Readings(naive, drawn.reshape(len(samples), -1), met.foot, met.distance <= REACH)


def _read_nearest(surface: Surface, field: Array, at: Array) -> Array:
    met = project(at, surface)
    return interpolated(field, surface.faces[met.face], met.weights)
