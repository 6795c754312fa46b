"""The moved prior's signed distance on a box, cut off at a distance beyond which it says no more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from ...arrays import Array, Ints
from ...geometry.closest_point import ClosestPoint
from ...geometry.surface import Surface
from ...levelset.grid.distance import signed_distance

PAD = 3  # nodes around what the box must hold


@dataclass(frozen=True, eq=False)
class MovedPrior:
    """The moved prior psi.T is negative inside, at most `clip` either way, on the nodes (index + low) *
    spacing of a box.
    """

    surface: Surface
    spacing: float
    clip: float
    low: Ints
    box: Array
    tree: ClosestPoint

    @classmethod
    def of(cls, surface: Surface, points: Array, spacing: float, clip: float) -> MovedPrior:
        """Make the moved prior on a box that holds the surface and the points (n, 3). Raises InputError where
        it is open.
        """
        near = signed_distance(surface.vertices, surface.faces, spacing, clip + spacing)
        band = near.band
        room = PAD + int(np.ceil(clip / spacing))
        low = np.minimum(band.low, np.floor(points.min(axis=0) / spacing).astype(np.int64) - room)
        end = np.maximum(
            band.low + band.shape, np.ceil(points.max(axis=0) / spacing).astype(np.int64) + room + 1
        )
        box = np.full(end - low, clip)
        at = tuple(slice(o, o + n) for o, n in zip(band.low - low, band.shape, strict=True))
        box[at] = np.clip(band.dense(near.phi), -clip, clip)
        return cls(surface, spacing, clip, low, box, surface.closest_point)

    def at(self, points: Array) -> Array:
        """Return the values (n,) at points (n, 3)."""
        inside = (points / self.spacing - self.low).T
        return np.asarray(map_coordinates(self.box, inside, order=1, mode="nearest"))

    def slope(self, points: Array) -> Array:
        """Return the gradient (n, 3), over two spacings: shorter than 1 where the distance is cut off."""
        step = self.spacing * np.eye(3)
        differences = [self.at(points + along) - self.at(points - along) for along in step]
        return np.column_stack(differences) / (2.0 * self.spacing)
