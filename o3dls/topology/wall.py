"""A surface as points see it: their feet on it, and their distances from it."""

from __future__ import annotations

import numpy as np

from ..arrays import Array, Ints
from ..geometry.closest_point import ClosestPoint
from ..geometry.differential import normals_and_curvature
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface
from .settings import ObservationSettings


class Wall:
    """A wall is a surface with normals and curvature at its vertices, and exact feet and signed distances of
    points.
    """

    def __init__(self, surface: Surface, settings: ObservationSettings | None = None) -> None:
        most = (settings or ObservationSettings()).curved.most_curvature
        self.surface = surface
        self.faces = surface.faces
        self.radius = rms_radius(surface.vertices)
        self.normals, self.curvature = normals_and_curvature(surface.vertices, self.faces, most / self.radius)
        self.tree = ClosestPoint(surface.vertices, surface.faces)

    def look(self, points: Array) -> tuple[Array, Ints, Array]:
        """Return the signed distance (n,), corner vertices (n, d) of the foot's face and its barycentric
        weights (n, d).
        """
        distance, face, weights = self.nearest(points)
        return distance, self.faces[face], weights

    def nearest(self, points: Array, hint: Ints | None = None) -> tuple[Array, Ints, Array]:
        """Return the signed distance (n,), face (n,) of the foot and its barycentric weights (n, d); `hint`
        (n,): faces that are probably near.
        """
        squared, face, foot, weights = self.tree.query(points, hint=hint)
        outward = np.einsum("nc,ncd->nd", weights, self.normals[self.faces[face]])
        inside = ((points - foot) * outward).sum(axis=1) < 0.0
        return np.sqrt(squared) * np.where(inside, -1.0, 1.0), face, weights
