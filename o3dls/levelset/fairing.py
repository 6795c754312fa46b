"""What smoothing would do to a surface: the part of the prior that may be roughness of its segmentation and not of the wall."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import cg

from ..geometry import Array, Ints
from .shape import vertex_normals

PRECISION = 1e-3  # of the smoothed positions: a share of the roughness that no evidence would notice


def fairing(vertices: Array, faces: Ints, length: float) -> Array:
    """Distance (n,) along the normals by which smoothing over `length` moves each vertex: minus the twice high-passed positions.

    One pass is an implicit step of the heat flow (Desbrun et al. 1999), x = (I - length^2 / 2 Laplace)^-1 y. Taken twice, what
    bends over more than the length stays as it is: a vein keeps its radius, a bump goes.
    """
    n, dim = vertices.shape
    i = faces.ravel() if dim == 3 else faces[:, 0]
    j = np.roll(faces, -1, axis=1).ravel() if dim == 3 else faces[:, 1]
    i, j = np.r_[i, j], np.r_[j, i]
    adjacency = coo_matrix((np.ones(len(i)), (i, j)), shape=(n, n)).tocsr()
    # with unit weights, mean squares of the edges are what makes the graph's Laplacian that of a surface of dim - 1 dimensions
    mass = np.bincount(i, ((vertices[i] - vertices[j]) ** 2).sum(axis=1), minlength=n) / (2.0 * (dim - 1))
    diagonal = mass + 0.5 * length**2 * np.bincount(i, minlength=n)
    system = (diags(diagonal) - 0.5 * length**2 * adjacency).tocsr()

    def rough(x: Array) -> Array:
        smooth = [cg(system, mass * y, x0=y, rtol=PRECISION, M=diags(1.0 / diagonal))[0] for y in x.T]
        return np.asarray(x - np.stack(smooth, axis=1))

    bumps = rough(rough(vertices - vertices.mean(axis=0)))
    return np.asarray(-(bumps * vertex_normals(vertices, faces)).sum(axis=1))
