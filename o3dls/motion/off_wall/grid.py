"""A motion off the wall on a regular grid, there and back, as programs of images hold it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Mask
from ...errors import InputError
from ...geometry.similarity import apply, inverse
from .field import OffWall
from .inverse import fixed_point
from .settings import SETTINGS


@dataclass(frozen=True, eq=False)
class DisplacementGrid:
    """A grid has displacements (nx, ny, nz, 3) at nodes; `affine` (4, 4) takes an index to the frame of both.
    Between nodes it is trilinear, and outside 0.
    """

    values: NDArray[np.floating]
    affine: Array

    def __call__(self, points: Array) -> Array:
        from scipy.ndimage import map_coordinates

        local = np.ascontiguousarray(apply(self._to_index, points).T)
        found = [map_coordinates(self.values[..., axis], local, order=1) for axis in range(3)]
        return np.stack(found, axis=1)

    @property
    def nodes(self) -> Array:
        """The places (n, 3) of the nodes, last axis fastest."""
        return grid_nodes(self.affine, self.values.shape[:3])

    @property
    def folded(self) -> Mask:
        """Where (n,) the displacement folds space at a node."""
        spacing = np.linalg.norm(self.affine[:3, :3], axis=0)
        slopes = np.stack([np.gradient(self.values, s, axis=k) for k, s in enumerate(spacing)], axis=-1)
        turned = slopes @ (self.affine[:3, :3] / spacing).T  # from along the axes of the grid to its frame's
        return np.asarray(np.linalg.det(np.eye(3) + turned).reshape(-1) <= 0.0)

    @cached_property
    def _to_index(self) -> Array:
        return inverse(self.affine)


@dataclass(frozen=True, eq=False)
class GridMotion:
    """A motion on a grid has a field `there`, behind which acts `T_map_prior` (4, 4), and a field `back`,
    which acts behind the inverse of that. All of it is in one frame.

    failed (n,) marks nodes without an inverse, and residual (n,) says how far each is missed.
    """

    there: DisplacementGrid
    back: DisplacementGrid
    T_map_prior: Array
    residual: Array
    failed: Mask

    def forward(self, points: Array) -> Array:
        return apply(self.T_map_prior, points + self.there(points))

    def good(self, points: Array) -> Mask:
        """Return where (n,) all nodes of the grid around a place (n, 3) of the prior's side have an
        inverse.
        """
        from scipy.ndimage import map_coordinates

        shape = self.there.values.shape[:3]
        local = apply(inverse(self.there.affine), points)
        low = np.ascontiguousarray(np.floor(local + SETTINGS.rounding).T)
        bad = self.failed.reshape(shape).astype(np.uint8)
        around = [low + np.array(corner)[:, None] for corner in np.ndindex(2, 2, 2)]
        found = [map_coordinates(bad, at, order=0, mode="nearest") for at in around]
        return np.asarray(~np.any(found, axis=0))

    def inverse(self, points: Array) -> Array:
        posed = apply(inverse(self.T_map_prior), points)
        return posed + self.back(posed)


def grid_nodes(affine: Array, shape: tuple[int, ...]) -> Array:
    """Return the places (n, 3) of the nodes of a grid, last axis fastest."""
    return apply(affine, np.indices(shape).reshape(3, -1).T)


def grid_of(field: OffWall, spacing: float, turn: Array) -> tuple[Array, tuple[int, ...]]:
    """Return the affine (4, 4) and the shape of a grid over all of a field, along the axes of a frame that
    `turn` (4, 4) leads to. Raises InputError where it would have too many nodes.
    """
    ends = apply(turn, np.array(field.box))
    low, high = ends.min(axis=0), ends.max(axis=0)
    shape = np.ceil((high - low) / spacing).astype(int) + 1
    if shape.prod() > SETTINGS.most_nodes:
        raise InputError(
            f"spacing = {spacing:g} mm: gives {shape.prod():.3g} nodes: must be at most "
            f"{SETTINGS.most_nodes:.3g}; "
            f"say {spacing * 1.05 * (shape.prod() / SETTINGS.most_nodes) ** (1 / 3):.2g}"
        )
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = low
    return affine, tuple(shape.tolist())


def on_grid(field: OffWall, spacing: float, turn: Array, T_map_prior: Array) -> GridMotion:
    """Return a field at nodes `spacing` apart, and its inverse by fixed point at the same ones.

    turn (4, 4) leads from the prior's frame to that of the grid, in which `T_map_prior` is.
    """
    affine, shape = grid_of(field, spacing, turn)
    nodes = grid_nodes(affine, shape)
    shift = field.displacement(apply(inverse(turn), nodes)) @ turn[:3, :3].T
    # as float32, in which files hold it: the inverse is that of what is written
    there = DisplacementGrid(shift.astype(np.float32).reshape(*shape, 3), affine)
    found = fixed_point(there, nodes)
    back = DisplacementGrid(found.shift.astype(np.float32).reshape(*shape, 3), affine)
    failed = there.folded | ~(found.residual <= SETTINGS.tolerance)
    return GridMotion(there, back, T_map_prior, found.residual, failed)
