"""A surface that moves along its own normals, and how points see it."""

from __future__ import annotations

import numpy as np

from ..geometry import Array, Ints, Surface
from .closest import ClosestPoint


class Wall:
    """A surface that moves along its own normals: u (v,) outward, exact feet and signed distances of points at every position."""

    def __init__(self, surface: Surface) -> None:
        self.rest = surface.vertices
        self.normals = surface.vertex_normals
        self.faces = surface.faces
        self.tree = ClosestPoint(surface.vertices, surface.faces)

    def move(self, u: Array) -> Array:
        """Put the wall at rest + u * normal; the vertices there."""
        self.tree.refit(self.rest + u[:, None] * self.normals)
        return self.tree.vertices

    def look(self, points: Array) -> tuple[Array, Ints, Array]:
        """Signed distance (n,), corner vertices (n, d) of the foot's face and its barycentric weights (n, d)."""
        squared, face, foot, weights = self.tree.query(points)
        corners = self.faces[face]
        outward = np.einsum("nc,ncd->nd", weights, self.normals[corners])
        return np.sqrt(squared) * np.where(((points - foot) * outward).sum(axis=1) < 0.0, -1.0, 1.0), corners, weights
