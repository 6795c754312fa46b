"""Compiled loops of the motion: Matern correlations, fields from weights, and local kriging."""

from __future__ import annotations

import numpy as np
from numba import njit

SQRT5 = 5.0**0.5
FARTHEST = 40.0  # scaled distance beyond which no correlation is left
NUGGET = 1e-6  # of the variance, since nodes can coincide: far below any noise


@njit(cache=True, nogil=True)
def matern(a, b, length):  # type: ignore[no-untyped-def]
    """Return the Matern 5/2 correlation (n, m) of two point sets, within 1e-11."""
    out = np.empty((a.shape[0], b.shape[0]))
    squared = np.empty(b.shape[0])
    columns = np.ascontiguousarray(b.T)
    for i in range(a.shape[0]):
        squared_distances(a[i], columns, squared)
        matern_decay(squared, SQRT5 / length, out[i])
    return out


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def add_correlated(a, out, b, lengths, values):  # type: ignore[no-untyped-def]
    """Add to out (n, q), over lengths (l,), the correlations (n, m) times values (l, q, m); of those no more
    than a row is in memory.
    """
    n, m, q = a.shape[0], b.shape[0], values.shape[1]
    squared = np.empty(m)
    row = np.empty(m)
    columns = np.ascontiguousarray(b.T)
    for i in range(n):
        squared_distances(a[i], columns, squared)
        for k in range(len(lengths)):
            matern_decay(squared, SQRT5 / lengths[k], row)
            for c in range(q):
                total = 0.0
                for j in range(m):
                    total += row[j] * values[k, c, j]
                out[i, c] += total


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def add_covariance(a, pulls, out, b, others, lengths):  # type: ignore[no-untyped-def]
    """Add to out (n, m) the correlations (n, m) times pulls (n, l, q) times others (q, m), over lengths
    (l,).
    """
    squared, row, shared = np.empty((3, b.shape[0]))
    columns = np.ascontiguousarray(b.T)
    for i in range(a.shape[0]):
        squared_distances(a[i], columns, squared)
        for k in range(len(lengths)):
            matern_decay(squared, SQRT5 / lengths[k], row)
            shared[:] = 0.0
            for c in range(others.shape[0]):
                for j in range(len(shared)):
                    shared[j] += pulls[i, k, c] * others[c, j]
            for j in range(len(shared)):
                out[i, j] += row[j] * shared[j]


@njit(cache=True, nogil=True)
def add_scaled(out, matrix, factor):  # type: ignore[no-untyped-def]
    """Add to out (n, m) a matrix times a factor, in one pass."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] += factor * matrix[i, j]


@njit(cache=True, inline="always")
def squared_distances(place, columns, out):  # type: ignore[no-untyped-def]
    """Write the squared distances (m,) of a place (d,) from the columns (d, m)."""
    out[:] = 0.0
    for k in range(columns.shape[0]):
        for j in range(columns.shape[1]):
            out[j] += (place[k] - columns[k, j]) ** 2


@njit(cache=True, inline="always")
def matern_decay(squared, scale, out):  # type: ignore[no-untyped-def]
    """Write the correlations (m,) at squared distances (m,) times scale^2.

    Plain loops and a polynomial for the exponential, exp(-s) = exp(-s / 256)^256, because a compiler turns
    these into vector instructions, and calls of exp it does not: ten times faster.
    """
    for j in range(len(squared)):
        s = min(scale * np.sqrt(squared[j]), FARTHEST)
        x = s * (1 / 256)
        e = 1.0 - x * (1.0 - x * (1 / 2 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120)))))
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        out[j] = (1.0 + s + s * s * (1 / 3)) * e


@njit(cache=True, nogil=True)
def kriging_weights(at, near, weights, nodes, length):  # type: ignore[no-untyped-def]
    """Fill in weights (m, k), summing to one, of the nodes (m, k) near each place: correlations among them
    solved for those with it.

    By Cholesky's factorisation written out: on so small a system a library's call takes longer than its
    arithmetic.
    """
    m, k = near.shape
    here = np.empty((k + 1, nodes.shape[1]))
    for i in range(m):
        w = weights[i]
        for c in range(here.shape[1]):  # a slice assigned would compile for seconds
            for j in range(k):
                here[j, c] = nodes[near[i, j], c]
            here[k, c] = at[i, c]
        factor = matern(here, here, length)
        for j in range(k):
            w[j] = factor[j, k]
            factor[j, j] += NUGGET
        for j in range(k):
            for q in range(j + 1):
                for c in range(q):
                    factor[j, q] -= factor[j, c] * factor[q, c]
                factor[j, q] = np.sqrt(factor[j, j]) if q == j else factor[j, q] / factor[q, q]
            for c in range(j):
                w[j] -= factor[j, c] * w[c]
            w[j] /= factor[j, j]
        for j in range(k - 1, -1, -1):
            for c in range(j + 1, k):
                w[j] -= factor[c, j] * w[c]
            w[j] /= factor[j, j]
        w /= w.sum()
