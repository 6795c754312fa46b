"""Shapes to surfaces: Open3D's isosurface on a grid, vertices evened out and put back onto the zero set."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from o3dls import Surface

from .shapes import Array, Shape, gradient, project


def mesh(shape: Shape, low: ArrayLike, high: ArrayLike, spacing: float) -> Surface:
    """Closed triangle mesh of a 3D shape that lies within the box; edges are about as long as the spacing."""
    import open3d as o3d

    low = np.asarray(low, dtype=np.float64)
    axes = [np.arange(a, b + spacing, spacing) for a, b in zip(low, np.asarray(high), strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    box = shape(grid.reshape(-1, 3)).reshape(grid.shape[:3]).astype(np.float32)
    raw = o3d.t.geometry.TriangleMesh.create_isosurfaces(o3d.core.Tensor(np.ascontiguousarray(box.T)), [0.0])
    vertices = raw.vertex.positions.numpy().astype(np.float64) * spacing + low
    faces = raw.triangle.indices.numpy()[:, ::-1].astype(np.int64)  # Open3D winds towards the smaller values
    return Surface(_evened(shape, vertices, faces), faces)


def _evened(shape: Shape, vertices: Array, faces: NDArray[np.int64], rounds: int = 8) -> Array:
    """Vertices moved along the surface towards the mean of their neighbours: the isosurface's slivers become
    triangles.
    """
    start = faces.ravel()
    end = np.roll(faces, -1, axis=1).ravel()
    valence = np.bincount(start, minlength=len(vertices))[:, None]
    vertices = project(shape, vertices)
    for _ in range(rounds):
        mean = np.zeros_like(vertices)
        np.add.at(mean, start, vertices[end])
        step = mean / valence - vertices
        normal = gradient(shape, vertices)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        vertices = project(
            shape, vertices + 0.5 * (step - (step * normal).sum(axis=1, keepdims=True) * normal), rounds=1
        )
    return vertices
