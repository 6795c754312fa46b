"""Pairs of measured points and their closest points on the moved prior surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Ints
from ..geometry.similarity import apply, rms_radius, scale_of
from ..geometry.surface import Surface

APART = 1e-7  # distance over the surface's radius from which on the direction of a gap is not rounding


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs are points (n, d) with their feet on the surface (n, d), the outward unit normals there (n, d),
    all in the map frame; faces (n,).
    """

    points: Array
    feet: Array
    normals: Array
    faces: Ints

    def of(self, rows: Ints) -> Pairs:
        """Return the pairs of the given rows."""
        return Pairs(self.points[rows], self.feet[rows], self.normals[rows], self.faces[rows])

    @property
    def gaps(self) -> Array:
        """From foot to point, (n, d)."""
        return self.points - self.feet

    @property
    def distances(self) -> Array:
        return np.asarray(np.linalg.norm(self.gaps, axis=1))

    @property
    def signed(self) -> Array:
        """Distances (n,) from the tangent planes, negative inside."""
        return np.asarray((self.gaps * self.normals).sum(axis=1))


class SurfaceMatcher:
    """A matcher finds closest points on a surface that moves by similarities: the tree is built once, in the
    prior frame, and the points move instead.
    """

    def __init__(self, surface: Surface) -> None:
        self.surface = surface
        self.tree = surface.closest_point
        self.radius = rms_radius(surface.vertices)

    def match(self, points: Array, T_map_prior: Array, last: Pairs | None = None) -> Pairs:
        """Return the pairs of points (n, d) in the map frame with the surface moved by `T_map_prior`; the
        pairs of a pose nearby save time.
        """
        local = apply(np.asarray(np.linalg.inv(T_map_prior)), points)
        _, faces, feet, _ = self.tree.query(local, hint=None if last is None else last.faces)
        normals = self._outward_normals(local - feet, faces) @ T_map_prior[:-1, :-1].T / scale_of(T_map_prior)
        return Pairs(points, apply(T_map_prior, feet), normals, faces)

    def _outward_normals(self, gaps: Array, faces: Ints) -> Array:
        """Return outward unit normals: the gap's own direction, which varies smoothly where face normals jump
        (a step that sees the jumps never comes to rest), or the face's normal where the point lies on it.
        """
        corners = self.surface.faces[faces]  # the 250 faces in question, not all
        flat = Surface(
            self.surface.vertices[corners.ravel()], np.arange(corners.size).reshape(corners.shape)
        ).face_normals
        outward = np.where((gaps * flat).sum(axis=1) < 0.0, -1.0, 1.0)
        distances = np.linalg.norm(gaps, axis=1)
        apart = distances > APART * self.radius
        return np.where(apart[:, None], gaps * (outward / np.maximum(distances, 1e-300))[:, None], flat)
