"""Fairing: what bends over less than a length goes. For a prior rougher than its wall, and for normals that do not follow bumps."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import cg

from ..geometry import Array, Ints
from .shape import vertex_normals

PRECISION = 1e-3  # of the smoothed positions, in rms radii: far below any noise


def fair(vertices: Array, faces: Ints, length: float) -> Array:
    """Vertices (n, d) moved along their normals to where smoothing over `length` puts them: less their twice high-passed positions.

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
    centred = vertices - vertices.mean(axis=0)
    error = PRECISION * float(np.sqrt((centred**2).sum() / n) * np.linalg.norm(mass))

    def smooth(x: Array, guess: Array) -> Array:
        columns = zip(x.T, guess.T, strict=True)
        return np.stack([cg(system, mass * y, x0=z, rtol=0.0, atol=error, M=diags(1.0 / diagonal))[0] for y, z in columns], axis=1)

    rough = centred - smooth(centred, centred)
    rough -= smooth(rough, np.zeros_like(rough))
    normals = vertex_normals(vertices, faces)
    return np.asarray(vertices - (rough * normals).sum(axis=1, keepdims=True) * normals)
