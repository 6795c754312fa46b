"""Pairs of measured points and their closest points on the moved prior surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import Array, Ints, Surface, apply, scale_of


@dataclass(frozen=True, eq=False)
class Pairs:
    """Points (n, d), their feet on the surface (n, d), and the outward unit normals there (n, d), all in the map frame."""

    points: Array
    feet: Array
    normals: Array

    @property
    def gaps(self) -> Array:
        """From foot to point, (n, d)."""
        return self.points - self.feet

    @property
    def distances(self) -> Array:
        return np.asarray(np.linalg.norm(self.gaps, axis=1))


class SurfaceMatcher:
    """Closest points on a surface that moves by similarities: the tree is built once, in the prior frame."""

    def __init__(self, surface: Surface) -> None:
        from ..levelset.closest import ClosestPoint

        self.surface = surface
        self.tree = ClosestPoint(surface.vertices, surface.faces)
        self.radius = float(np.sqrt(surface.vertices.var(axis=0).sum()))

    def match(self, points: Array, T_map_prior: Array) -> Pairs:
        """Pairs of points (n, d) in the map frame with the surface moved by `T_map_prior`."""
        _, faces, feet, _ = self.tree.query(apply(np.linalg.inv(T_map_prior), points))
        normals = self._normals(faces) @ T_map_prior[:-1, :-1].T / scale_of(T_map_prior)
        return Pairs(points, apply(T_map_prior, feet), normals)

    def _normals(self, faces: Ints) -> Array:
        """Unit normals of the named faces only: a prior has a hundred times more faces than there are points."""
        return Surface(self.surface.vertices, self.surface.faces[faces]).face_normals
