"""Fairing: what bends over less than a length goes. For a prior rougher than its wall, and for normals that
do not follow bumps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..arrays import Array, Ints
from .differential import neighbours

PRECISION = 1e-3  # of the smoothed positions, in rms radii: far below any noise
MOST_STEPS = 5000  # 150 are usual


class _Graph(NamedTuple):
    """A graph has the neighbours `near` of each vertex, from begin[i] to begin[i + 1], and masses (n,)."""

    begin: NDArray[np.int32]
    near: NDArray[np.int32]
    mass: Array


def fair(vertices: Array, rough: Array, normals: Array) -> Array:
    """Return the vertices (n, d) less their roughness (n, d), of which only what is along the normals (n, d)
    counts on a surface.
    """
    if vertices.shape[1] == 2:
        # in 2D the whole displacement counts: a curve that shortens as a whole does not cross itself
        return vertices - rough
    # only along the normals, or an uneven mesh would drift along the wall
    return np.asarray(vertices - (rough * normals).sum(axis=1, keepdims=True) * normals)


def roughness(vertices: Array, faces: Ints, length: float) -> Array:
    """Return twice high-passed positions (n, d): what of them bends over less than a length.

    One pass takes away an implicit step of the heat flow (Desbrun et al. 1999), x = (I - length^2 / 2
    Laplace)^-1 y. Taken twice, what bends over more than the length is not in it: a vein keeps its radius, a
    bump goes.
    """
    n, dim = vertices.shape
    edges = neighbours(faces, n)
    begin, near = edges.indptr, edges.indices
    # with unit weights, mean squares of the edges are what makes the graph's Laplacian that of a surface of
    # dim - 1 dimensions
    here = np.repeat(np.arange(n), np.diff(begin))
    mass = np.bincount(here, ((vertices[here] - vertices[near]) ** 2).sum(axis=1), minlength=n) / (
        2.0 * (dim - 1)
    )
    mass = np.maximum(mass, 1e-12 * mass.max())  # a vertex of no face stays where it is
    centred = np.zeros((n, 3))
    centred[:, :dim] = vertices - vertices.mean(axis=0)
    error = PRECISION * float(np.sqrt((centred**2).sum() / n) * np.linalg.norm(mass))
    graph, pull = _Graph(begin, near, mass), 0.5 * length**2
    rough = centred - _smooth_columns(graph, pull, centred, centred, error)
    rough -= _smooth_columns(graph, pull, rough, np.zeros_like(rough), error)
    return np.asarray(rough[:, :dim])


@njit(cache=True, nogil=True, error_model="numpy")
def _smooth_columns(graph, pull, y, guess, error):  # type: ignore[no-untyped-def]
    """Solve (M + pull K) x = M y for columns x (n, 3), K of a graph with unit weights, until no residual's
    norm exceeds `error`.

    Conjugate gradients with Jacobi's preconditioner, all columns in one pass, which a library's does one by
    one. They are written out so that their sums stay in registers.
    """
    begin, near, mass = graph
    n = len(mass)
    weight = mass + pull * (begin[1:] - begin[:-1])
    share = 1.0 / weight
    x = np.zeros((n, 3))
    r = mass.reshape(-1, 1) * y
    p = guess.copy()
    q = np.empty((n, 3))
    rho = np.zeros(3)
    for k in range(MOST_STEPS):
        u = v = w = 0.0
        for i in range(n):
            a, b, c = weight[i] * p[i, 0], weight[i] * p[i, 1], weight[i] * p[i, 2]
            for e in range(begin[i], begin[i + 1]):
                j = near[e]
                a -= pull * p[j, 0]
                b -= pull * p[j, 1]
                c -= pull * p[j, 2]
            q[i, 0], q[i, 1], q[i, 2] = a, b, c
            u += p[i, 0] * a
            v += p[i, 1] * b
            w += p[i, 2] * c
        step = rho / np.maximum(np.array([u, v, w]), 1e-300)
        if k == 0:  # p is the guess, and q what the system makes of it
            step[:] = 1.0
        a = b = c = u = v = w = 0.0
        for i in range(n):
            for axis in range(3):
                x[i, axis] += step[axis] * p[i, axis]
                r[i, axis] -= step[axis] * q[i, axis]
            a += r[i, 0] * r[i, 0]
            b += r[i, 1] * r[i, 1]
            c += r[i, 2] * r[i, 2]
            u += r[i, 0] * r[i, 0] * share[i]
            v += r[i, 1] * r[i, 1] * share[i]
            w += r[i, 2] * r[i, 2] * share[i]
        if max(a, b, c) <= error**2:
            break
        new = np.array([u, v, w])
        turn = new / np.maximum(rho, 1e-300) if k > 0 else rho
        for i in range(n):
            for axis in range(3):
                p[i, axis] = r[i, axis] * share[i] + turn[axis] * p[i, axis]
        rho = new
    return x
