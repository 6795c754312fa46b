"""Images as a scanner makes them of an atrium: blood, a wall of some thickness with values of its own as in
late enhancement, and what lies around, on voxels that may lie obliquely and be anisotropic.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from o3dls import Surface

from .segmentation import solid
from .shapes import Array

CHUNK = 200_000  # voxels at one time


@dataclass(frozen=True, eq=False)
class Grid:
    """Voxels (ni, nj, nk) and the matrix from an index to mm in the frame of the surface."""

    shape: tuple[int, int, int]
    affine: Array

    @property
    def spacing(self) -> Array:
        return np.asarray(np.linalg.norm(self.affine[:3, :3], axis=0))

    def places(self) -> Array:
        """Centres (n, 3) of the voxels, the last axis running fastest."""
        index = np.indices(self.shape).reshape(3, -1).T
        return np.asarray(index @ self.affine[:3, :3].T + self.affine[:3, 3])


@dataclass(frozen=True)
class Tissue:
    """Values of blood and surroundings, thickness of the wall in mm, and noise (standard deviation)."""

    blood: float = 300.0
    around: float = 120.0
    thickness: float = 2.5
    noise: float = 12.0


def oblique_grid(rng: np.random.Generator, surface: Surface, spacing: Array, margin: float = 25.0) -> Grid:
    """A grid around a surface whose axes are turned at random, and no axis of the body's."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes = axes * np.sign(np.linalg.det(axes))
    along = surface.vertices @ axes
    low, high = along.min(axis=0) - margin, along.max(axis=0) + margin
    i, j, k = np.ceil((high - low) / spacing).astype(int).tolist()
    affine = np.eye(4)
    affine[:3, :3] = axes * spacing
    affine[:3, 3] = axes @ low
    return Grid((i, j, k), affine)


def late_enhancement(
    surface: Surface,
    grid: Grid,
    wall: Callable[[Array], Array],
    tissue: Tissue = Tissue(),
    rng: np.random.Generator | None = None,
) -> Array:
    """Values (ni, nj, nk): those of blood inside the surface, of `wall` at places (n, 3) within the thickness
    outside of it, and of what lies around beyond; noise where there is a generator.
    """
    shape, places = solid(surface), grid.places()
    values = np.empty(len(places))
    for start in range(0, len(places), CHUNK):
        at = places[start : start + CHUNK]
        distance = shape(at)
        within = (distance >= 0.0) & (distance <= tissue.thickness)
        chunk = np.where(distance < 0.0, tissue.blood, tissue.around)
        chunk[within] = wall(at[within])
        values[start : start + CHUNK] = chunk
    noise = 0.0 if rng is None else tissue.noise * rng.normal(size=len(values))
    return np.asarray((values + noise).reshape(grid.shape))
