"""What every motion of the prior can do; and a motion known by where it brought the vertices of the prior, as
run folders keep it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ..arrays import Array, Ints
from ..geometry.closest_point import ClosestPoint
from ..geometry.surface import Surface
from .wall.kept import KeptPosterior


class Motion(Protocol):
    """A motion takes the prior frame to the map frame, as it was fitted, and knows its uncertainty."""

    def __hash__(self) -> int:
        """Of the object itself: two motions are never compared."""

    def __call__(self, points: Array) -> Array:
        """Positions (n, d) in the map frame of points (n, d) of the prior frame."""

    def sd(self, points: Array, normals: Array) -> Array:
        """Return the posterior standard deviation (n,) along `normals` (map frame) of the motion at points of
        the prior frame.
        """


@dataclass(frozen=True, eq=False)
class WallModes:
    """Modes say how the errors of a moved prior go together, at some of its vertices: `places` (m,) and
    `modes` (m, r), such that the errors along the moved normals there have the covariance modes modes^T.
    """

    places: Ints
    modes: Array


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """A recorded motion takes the prior frame to the map frame by the prior and the same surface after it
    (`Motion`).

    A place beside the surface keeps its offset from the nearest place on it, turned and scaled by the
    similarity `T_map_prior` (d+1, d+1). deviation (n,) is that of each vertex along its moved normal, and
    modes say how deviations go together, and `kept` the posterior in space, where the run kept that.
    """

    prior: Surface
    moved: Surface
    T_map_prior: Array
    deviation: Array
    modes: WallModes | None = None
    kept: KeptPosterior | None = None

    def __call__(self, points: Array) -> Array:
        at, offset = _carry_points(self._on_prior, self.moved, points)
        return at + offset @ self.T_map_prior[:-1, :-1].T

    def inverse(self, points: Array) -> Array:
        """Return the places (n, d) of the prior frame that came to lie at points (n, d) of the map frame."""
        at, offset = _carry_points(self._on_moved, self.prior, points)
        return at + offset @ np.linalg.inv(self.T_map_prior[:-1, :-1]).T

    def sd(self, points: Array, normals: Array) -> Array:
        """Return the standard deviation (n,) at the nearest place of the prior; normals count as those of the
        wall.
        """
        _, face, _, weights = self._on_prior.query(points)
        return np.asarray((self.deviation[self.prior.faces[face]] * weights).sum(axis=1))

    @cached_property
    def _on_prior(self) -> ClosestPoint:
        return ClosestPoint(self.prior.vertices, self.prior.faces)

    @cached_property
    def _on_moved(self) -> ClosestPoint:
        return ClosestPoint(self.moved.vertices, self.moved.faces)


def _carry_points(tree: ClosestPoint, other: Surface, points: Array) -> tuple[Array, Array]:
    """Return the places on the other surface of the same faces that correspond to the nearest places to
    points (n, d), and the offsets of the points from the latter.
    """
    _, face, foot, weights = tree.query(np.asarray(points, dtype=np.float64))
    at = np.einsum("nk,nkd->nd", weights, other.vertices[other.faces[face]])
    return at, points - foot
