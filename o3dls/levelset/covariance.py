"""Prior covariance of the motion field: what displacements of the prior are likely, before any point is seen.

D(r) = A(r) b + S(r) e + w(r) x (r - centre) + sum_k u_k(r) + N(r) sum_k g_k(r) + sum_L exp(-|r-L|^2 / 2 l_a^2) c_L
at positions r of the posed prior. A b: translation, rotation and scale, nearly free; S e: traceless strains; w = B (r - centre) / radius +
h tanh((r - centre) . up / radius): a rotation that changes over the chamber, so that bending and twisting are cheap, B in any way, h
(tilts, where `up` is known) from bottom to top, levelling off so that the ends of veins do not whirl; u, g: Matern 5/2 fields, of
vectors and along the normal N (order >= 2: point data have no hold on rougher fields over a surface); c_L: shifts of anchors (vein
ostia), each its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy import sparse
from scipy.spatial import cKDTree

from ..geometry import Array

SQRT5 = 5.0**0.5
BLOCK = 4096  # places whose correlations are held at a time


@dataclass(frozen=True)
class Covariance:
    """Components of the field's covariance; their standard deviations come as one array: vector, normal, bend, strain, tilt, anchors.

    centre (d,) is the origin of the similarity part, whose own standard deviations are translation (a length), rotation (rad)
    and scale; vector and normal are correlation lengths; a bend is measured by how far one turns over `radius`; a tilt is one along
    the unit vector up (d,), where there is one; anchors (k, d) reach as far as anchor_length.
    """

    centre: Array
    vector: tuple[float, ...]
    normal: tuple[float, ...]
    radius: float
    anchors: Array
    anchor_length: float
    translation: float
    up: Array | None = None
    rotation: float = 0.1
    scale: float = 0.1

    @property
    def lengths(self) -> Array:
        return np.array(self.vector + self.normal)

    def similarity(self, at: Array) -> Array:
        """Features (n, d, k) of the similarity part at positions (n, d), each scaled to unit variance."""
        x, dim = at - self.centre, at.shape[1]
        shift = np.broadcast_to(self.translation * np.eye(dim), (len(x), dim, dim))
        return np.concatenate([shift, self.rotation * self.turns(at), self.scale * x[:, :, None]], axis=2)

    def turns(self, at: Array) -> Array:
        """Features (n, d, k) of unit rotations about the centre."""
        return np.stack([(at - self.centre) @ m.T for m in _skew(at.shape[1])], axis=2)

    def tunable(self, at: Array) -> list[Array]:
        """Features (n, d, k) of bends, strains and, where there are any, tilts and shifts of the anchors, for unit standard deviations."""
        x, turns = at - self.centre, self.turns(at)
        bends = np.concatenate([turns * x[:, None, j : j + 1] / self.radius for j in range(x.shape[1])], axis=2)
        strains = np.stack([x @ m.T for m in _traceless(at.shape[1])], axis=2)
        found = [bends, strains]
        if self.up is not None:
            found.append(turns * np.tanh(x @ self.up / self.radius)[:, None, None])
        return [*found, self._anchored(at)] if len(self.anchors) else found

    def _anchored(self, at: Array) -> Array:
        dim = at.shape[1]
        reach = np.exp(-0.5 * ((at[:, None] - self.anchors[None]) ** 2).sum(axis=2) / self.anchor_length**2)
        return np.asarray(np.einsum("nk,ab->nakb", reach, np.eye(dim)).reshape(len(at), dim, -1))


@dataclass(frozen=True)
class Observed:
    """Linear observations `directions . D(at)` (n, d), with `normal_part` (n,) = directions . N (zero where D has no field along it)."""

    at: Array
    directions: Array
    normal_part: Array


@dataclass(frozen=True)
class Places:
    """Places on the posed prior: positions (m, d) and the unit normals N (m, d) along which it likes to move."""

    at: Array
    normals: Array

    def observed(self, directions: Array) -> Observed:
        return Observed(self.at, directions, (self.normals * directions).sum(axis=1))


def grams(cov: Covariance, obs: Observed) -> tuple[Array, list[Array]]:
    """Gram matrix (n, n) of the similarity part and one of unit variance per tunable component."""
    fixed = _seen(obs, cov.similarity(obs.at))
    dots, sides = obs.directions @ obs.directions.T, np.outer(obs.normal_part, obs.normal_part)
    correlation = {length: _matern(obs.at, obs.at, length) for length in {*cov.vector, *cov.normal}}
    parts = [correlation[length] * dots for length in cov.vector] + [correlation[length] * sides for length in cov.normal]
    parts += [f @ f.T for f in (_seen(obs, features) for features in cov.tunable(obs.at))]
    return fixed @ fixed.T, parts


def displacement(cov: Covariance, sds: Array, obs: Observed, alpha: Array, places: Places) -> Array:
    """Field (m, d) at `places`, for observation weights alpha (n,) = C^-1 z."""
    at, normals = places.at, places.normals
    field = cov.similarity(at) @ (alpha @ _seen(obs, cov.similarity(obs.at)))
    k, split = len(cov.lengths), len(cov.vector)
    lengths, which = np.unique(cov.lengths, return_inverse=True)  # fields of one length share its correlation
    free = np.bincount(which[:split], sds[:split] ** 2, minlength=len(lengths))
    along = np.bincount(which[split:], sds[split:k] ** 2, minlength=len(lengths))
    for begin in range(0, len(at), BLOCK):
        block = slice(begin, begin + BLOCK)
        for length, of_vector, of_normal in zip(lengths, free, along, strict=True):
            correlation = _matern(at[block], obs.at, length)
            pull = of_vector * alpha[:, None] * obs.directions
            push = of_normal * alpha * obs.normal_part
            field[block] += correlation @ pull + (correlation @ push)[:, None] * normals[block]
    for sd, here, there in zip(sds[k:], cov.tunable(at), cov.tunable(obs.at), strict=True):
        field += here @ (sd**2 * (alpha @ _seen(obs, there)))
    return np.asarray(field)


def cross(cov: Covariance, sds: Array, a: Observed, b: Observed) -> Array:
    """Covariance (n, m) between two sets of observations."""
    total = _seen(a, cov.similarity(a.at)) @ _seen(b, cov.similarity(b.at)).T
    dots, sides = a.directions @ b.directions.T, np.outer(a.normal_part, b.normal_part)
    lengths, which = np.unique(cov.lengths, return_inverse=True)  # fields of one length share its correlation
    for index, length in enumerate(lengths):
        shared = [sds[i] ** 2 * (dots if i < len(cov.vector) else sides) for i in np.flatnonzero(which == index)]
        total += _matern(a.at, b.at, length) * sum(shared[1:], start=shared[0])
    k = len(cov.lengths)
    for sd, left, right in zip(sds[k:], cov.tunable(a.at), cov.tunable(b.at), strict=True):
        total += sd**2 * _seen(a, left) @ _seen(b, right).T
    return np.asarray(total)


def variance(cov: Covariance, sds: Array, obs: Observed) -> Array:
    """Prior variance (n,) of the observations: the diagonal of `cross(obs, obs)`."""
    k, split = len(cov.lengths), len(cov.vector)
    total = (_seen(obs, cov.similarity(obs.at)) ** 2).sum(axis=1)
    total += (sds[:split] ** 2).sum() * (obs.directions**2).sum(axis=1) + (sds[split:k] ** 2).sum() * obs.normal_part**2
    for sd, features in zip(sds[k:], cov.tunable(obs.at), strict=True):
        total += sd**2 * (_seen(obs, features) ** 2).sum(axis=1)
    return np.asarray(total)


def interpolation(nodes: Array, at: Array, length: float, neighbours: int = 8) -> sparse.csr_matrix:
    """Matrix (m, nodes) that interpolates a field of the given correlation length at places `at` (m, d) from nodes: local kriging."""
    k = min(neighbours, len(nodes))
    near = cKDTree(nodes).query(at, k=k)[1].reshape(len(at), k)
    begin = np.arange(0, near.size + 1, k)
    return sparse.csr_matrix((_kriging(nodes, at, near, length).ravel(), near.ravel(), begin), shape=(len(at), len(nodes)))


def _seen(obs: Observed, features: Array) -> Array:
    """Features (n, d, k) as the observations see them: along their directions, (n, k)."""
    return np.asarray(np.einsum("na,nak->nk", obs.directions, features))


def _skew(dim: int) -> list[Array]:
    pairs = [(0, 1)] if dim == 2 else [(0, 1), (0, 2), (1, 2)]
    return [_unit(dim, i, j) - _unit(dim, j, i) for i, j in pairs]


def _traceless(dim: int) -> list[Array]:
    """Orthonormal symmetric traceless matrices times sqrt(2), so that a strain's sd reads as its entry off the diagonal."""
    shear = [_unit(dim, i, j) + _unit(dim, j, i) for i in range(dim) for j in range(i + 1, dim)]
    stretch = [np.diag([1.0, -1.0] + [0.0] * (dim - 2))]
    return shear + stretch + ([np.diag([1.0, 1.0, -2.0]) / 3.0**0.5] if dim == 3 else [])


def _unit(dim: int, i: int, j: int) -> Array:
    m = np.zeros((dim, dim))
    m[i, j] = 1.0
    return m


@njit(cache=True)
def _matern(a, b, length):  # type: ignore[no-untyped-def]
    """Matern 5/2 correlation (n, m) of two point sets, within 1e-11.

    Plain loops and a polynomial for the exponential, exp(-s) = exp(-s / 256)^256, because a compiler turns these into vector
    instructions, and calls of exp it does not: ten times faster.
    """
    n, m, dim = a.shape[0], b.shape[0], a.shape[1]
    columns = np.ascontiguousarray(b.T)
    out = np.zeros((n, m))
    scale = SQRT5 / length
    for i in range(n):
        for k in range(dim):
            for j in range(m):
                out[i, j] += (a[i, k] - columns[k, j]) ** 2
        for j in range(m):
            s = min(scale * np.sqrt(out[i, j]), 40.0)  # beyond, nothing is left
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
            out[i, j] = (1.0 + s + s * s * (1 / 3)) * e
    return out


@njit(cache=True)
def _kriging(nodes, at, near, length):  # type: ignore[no-untyped-def]
    """Weights (m, k), summing to one, of the nodes (m, k) near each place: correlations among them solved for those with it.

    By Cholesky's factorisation written out: on so small a system a library's call takes longer than its arithmetic.
    """
    m, k = near.shape
    weights, here = np.empty((m, k)), np.empty((k + 1, nodes.shape[1]))
    for i in range(m):
        w = weights[i]
        here[:k], here[k] = nodes[near[i]], at[i]
        factor = _matern(here, here, length)
        for j in range(k):
            w[j] = factor[j, k]
            factor[j, j] += 1e-6  # nodes can coincide; a millionth of the variance is far below any noise
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
    return weights
