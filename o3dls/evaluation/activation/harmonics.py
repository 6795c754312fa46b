"""Harmonics of a wall: eigenfunctions of its Laplacian, of which processes on it are made, and the slope of
what is given at its vertices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.linalg import eigh
from scipy.sparse.linalg import splu

from ...arrays import TINY, Array, Ints, Mask
from ...geometry.spread import spread
from ...geometry.surface import Surface
from ...parallel import each

COUNT = 500  # on an atrium the shortest are 9 mm long
LEAST_COTANGENT = 1e-3  # slivers make weights of any sign
MORE, BUMP, PASSES = 1.2, 0.7, 3  # bumps a harmonic; their width over how far they are apart; smoothings
PARTS = 8  # of the bumps, which are smoothed side by side
SMOOTHNESS = 1.5  # of Matern's process: its paths have a slope


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Harmonics of a wall have eigenvalues (m,) in 1/mm², the least first, and values (n, m) at the vertices
    of the surface, 0 where there is no wall; their mean squares over the area are 1 over it.
    """

    surface: Surface
    wall: Mask
    eigenvalues: Array
    values: Array

    @classmethod
    def of(cls, surface: Surface, wall: Mask, count: int = COUNT) -> Harmonics:
        """Find the smoothest harmonics on the faces between vertices (n,) of the wall. Nothing flows over
        its border.
        """
        faces = surface.faces[wall[surface.faces].all(axis=1)]
        used = np.unique(faces)
        stiffness, mass = _stiffness(surface.vertices, faces), _masses(surface, faces)
        count = min(count, len(used) // 2)
        value, vector = _solve_smoothest(surface.vertices[used], stiffness[used][:, used], mass[used], count)
        values = np.zeros((len(wall), count))
        values[used] = vector
        return cls(surface, wall, np.maximum(value, 0.0), values)

    def spectrum(self, length: float) -> Array:
        """Return the variances (m,) of the harmonics in a process that varies over a length in mm (Matern's
        with a slope), whose variance is 1 in the mean over the wall.
        """
        density = (2.0 * SMOOTHNESS / length**2 + self.eigenvalues) ** -(SMOOTHNESS + 1.0)
        return np.asarray(density / density.sum() * self._area)

    @cached_property
    def _area(self) -> float:
        return float(self.surface.face_areas[self.wall[self.surface.faces].all(axis=1)].sum())

    @cached_property
    def frames(self) -> Array:
        """Two unit vectors (n, 2, 3) in the wall at each vertex."""
        normals = self.surface.vertex_normals
        first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
        first /= np.maximum(np.linalg.norm(first, axis=1), TINY)[:, None]
        return np.stack([first, np.cross(normals, first)], axis=1)

    def slopes(self, values: Array, at: Ints | None = None) -> Array:
        """Return the slope (2, k, ...) in the frames of values (n, ...) at vertices (k,), or at all: by area
        the mean of the faces of the wall about each.
        """
        rows = self._slope if at is None else self._slope[np.concatenate([at, at + len(self.wall)])]
        found = rows @ values.reshape(len(values), -1)
        return np.asarray(found.reshape(2, -1, *values.shape[1:]))

    @cached_property
    def _slope(self) -> sparse.csr_array:
        surface, n = self.surface, len(self.wall)
        kept = self.wall[surface.faces].all(axis=1) & (surface.face_areas > 0.0)
        faces, area, normals = surface.faces[kept], surface.face_areas[kept], surface.face_normals[kept]
        corners = surface.vertices[faces]
        edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        steep = np.cross(normals[:, None], edges) / (2.0 * area)[:, None, None]
        total = np.maximum(np.bincount(faces.ravel(), np.repeat(area, 3), n), TINY)
        at, of, axis = np.indices((3, 3, 2)).reshape(3, -1)  # of corners: whose slope, by whose value
        along = np.einsum("mjd,mjd->mj", self.frames[faces[:, at], axis], steep[:, of])
        weight = along * area[:, None] / total[faces[:, at]]
        rows = axis * n + faces[:, at]
        found = sparse.coo_array((weight.ravel(), (rows.ravel(), faces[:, of].ravel())), shape=(2 * n, n))
        return sparse.csr_array(found)


def _solve_smoothest(
    places: Array, stiffness: sparse.csr_array, mass: Array, count: int
) -> tuple[Array, Array]:
    """Return the least eigenvalues (m,) of a Laplacian (n, n) and eigenvectors (n, m): those of the functions
    that bumps at places spread over the wall span. That takes a tenth of the time of Lanczos' method.
    """
    nodes = spread(places, int(MORE * count))
    width = BUMP * np.sqrt(mass.sum() / len(nodes))
    smooth = splu(sparse.csc_array(sparse.diags_array(mass) + width**2 * stiffness))
    bumps: Array = np.zeros((len(places), len(nodes)))
    bumps[nodes, np.arange(len(nodes))] = 1.0
    for _ in range(PASSES):
        bumps = np.hstack(each(smooth.solve, np.array_split(mass[:, None] * bumps, PARTS, axis=1)))
    # the condition of the Gram matrix is 1e6 on an atrium: the bumps need not be made orthogonal first
    stiff, gram = bumps.T @ (stiffness @ bumps), bumps.T @ (mass[:, None] * bumps)
    value, vector = eigh(stiff, gram, subset_by_index=(0, count - 1))
    return value, bumps @ vector


def _stiffness(vertices: Array, faces: Ints) -> sparse.csr_array:
    """Return the Laplacian (n, n) by cotangents, integrated over the area about each vertex."""
    n = len(vertices)
    weights = sparse.csr_array((n, n))
    for k in range(3):
        corner, a, b = np.roll(faces, -k, axis=1).T
        u, v = vertices[a] - vertices[corner], vertices[b] - vertices[corner]
        sine = np.maximum(np.linalg.norm(np.cross(u, v), axis=1), TINY)
        half = sparse.csr_array((0.5 * (u * v).sum(axis=1) / sine, (a, b)), shape=(n, n))
        weights = weights + half + half.T
    weights.data = np.maximum(weights.data, LEAST_COTANGENT)
    return sparse.csr_array(sparse.diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights)


def _masses(surface: Surface, faces: Ints) -> Array:
    """Return each vertex's share (n,) of the area of faces."""
    corners = surface.vertices[faces]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    shares = np.bincount(faces.ravel(), np.repeat(area / 3.0, 3), len(surface.vertices))
    return np.asarray(np.maximum(shares, TINY))
