"""A surface that moves along its own normals, and how points see it."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import Array, Ints
from ..geometry.closest_point import ClosestPoint
from ..geometry.differential import normals_and_curvature
from ..geometry.similarity import principal_frame, rms_radius
from ..geometry.surface import Surface
from .settings import ObservationSettings


class Wall:
    """A surface that moves along its own normals: u (v,) outward, exact feet and signed distances of points
    at every position.
    """

    def __init__(self, surface: Surface, settings: ObservationSettings | None = None) -> None:
        most = (settings or ObservationSettings()).most_curvature
        self.surface = surface
        self.rest, self.faces = surface.vertices, surface.faces
        self.radius = rms_radius(self.rest)
        self.normals, self.curvature = normals_and_curvature(self.rest, self.faces, most / self.radius)
        self.tree = ClosestPoint(surface.vertices, surface.faces)

    @cached_property
    def frame(self) -> Array:
        """The wall's own axes (d+1, d+1), for what must not depend on those of the map."""
        return principal_frame(self.rest)

    def move(self, u: Array) -> None:
        """Put the wall at rest + u * normal."""
        self.tree = self.tree.at(self.rest + u[:, None] * self.normals)

    def look(self, points: Array) -> tuple[Array, Ints, Array]:
        """Signed distance (n,), corner vertices (n, d) of the foot's face and its barycentric weights (n,
        d).
        """
        distance, face, weights = self.nearest(points)
        return distance, self.faces[face], weights

    def nearest(self, points: Array, hint: Ints | None = None) -> tuple[Array, Ints, Array]:
        """Signed distance (n,), face (n,) of the foot and its barycentric weights (n, d); `hint` (n,): faces
        that are probably near.
        """
        squared, face, foot, weights = self.tree.query(points, hint=hint)
        outward = np.einsum("nc,ncd->nd", weights, self.normals[self.faces[face]])
        inside = ((points - foot) * outward).sum(axis=1) < 0.0
        return np.sqrt(squared) * np.where(inside, -1.0, 1.0), face, weights
