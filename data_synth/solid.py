"""What a closed surface encloses, as a shape: a surface that can be opened, cut and joined with others."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from o3dls import Surface

from . import wall
from .meshing import mesh
from .shapes import Array, Shape

MARGIN = 5.0  # mm of a grid around what it is to hold


def solid(surface: Surface) -> Shape:
    """The signed distance from a closed surface, as precise as Open3D's single floats."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(surface.vertices.astype(np.float32), surface.faces.astype(np.uint32))

    def distance(p: Array) -> Array:
        at = o3d.core.Tensor(np.ascontiguousarray(p, dtype=np.float32))
        found = scene.compute_signed_distance(at, nthreads=1, nsamples=3)
        return np.asarray(found.numpy(), dtype=np.float64)

    return distance


def sampled(shape: Shape, extent: Array, spacing: float) -> Shape:
    """A shape by cubic splines between the nodes of a grid around places (n, 3): much faster where it is
    asked often; edges are rounded by about the spacing.
    """
    low = extent.min(axis=0) - MARGIN
    nodes = _nodes(low, extent.max(axis=0) + MARGIN, spacing)
    values = shape(nodes.reshape(-1, 3)).reshape(nodes.shape[:3])
    weights = ndimage.spline_filter(values, 3, mode="nearest")

    def distance(p: Array) -> Array:
        at = ((p - low) / spacing).T
        return np.asarray(ndimage.map_coordinates(weights, at, order=3, mode="nearest", prefilter=False))

    return distance


def deepest(shape: Shape, extent: Array, spacing: float = 3.0) -> float:
    """The least value of a shape among places (n, 3), to about a third of the spacing."""
    nodes = _nodes(extent.min(axis=0), extent.max(axis=0), spacing)
    return float(shape(nodes.reshape(-1, 3)).min())


def meshed(shape: Shape, extent: Array, spacing: float) -> Surface:
    """The largest piece of a shape that lies within the bounds of places (n, 3)."""
    low, high = extent.min(axis=0) - MARGIN + spacing, extent.max(axis=0) + MARGIN - 2.0 * spacing
    return wall.largest(mesh(shape, low, high, spacing))


def _nodes(low: Array, high: Array, spacing: float) -> Array:
    """Nodes (i, j, k, 3) of a grid over a box."""
    axes = [np.arange(a, b + spacing, spacing) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
