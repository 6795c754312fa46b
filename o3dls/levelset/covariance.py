"""Prior covariance of the motion field: what displacements of the prior are likely, before any point is seen.

D(r) = A(r) b + sum_k u_k(r) + N(r) sum_k g_k(r) + sum_L exp(-|r-L|^2 / 2 l_a^2) c_L   at reference positions r (the posed prior):
A b: translation, rotation, scale and traceless strains, nearly free; u, g: Matern 5/2 fields, of vectors and along the normal N
(order >= 2, since point data have no hold on rougher fields over a surface); c_L: shifts of the anchors (vein ostia), which move on their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ..geometry import Array

SQRT5 = 5.0**0.5


@dataclass(frozen=True)
class Covariance:
    """Components of the field's covariance; their standard deviations come as one array: vector fields, normal fields, anchors.

    centre (d,) and size (the surface's rms radius) set origin and unit of the affine part, whose standard deviations are
    translation (lengths), rotation (rad), scale and strain; vector and normal are correlation lengths; anchors (k, d).
    """

    centre: Array
    size: float
    vector: tuple[float, ...]
    normal: tuple[float, ...]
    anchors: Array
    anchor_length: float
    translation: float
    rotation: float = 0.1
    scale: float = 0.1
    strain: float = 0.05

    @property
    def count(self) -> int:
        return len(self.vector) + len(self.normal) + (len(self.anchors) > 0)

    @property
    def lengths(self) -> Array:
        return np.array(self.vector + self.normal)

    def affine(self, at: Array) -> Array:
        """Features (n, d, k) of the affine part at positions (n, d), each scaled to unit variance."""
        x, dim = at - self.centre, at.shape[1]
        shift = np.broadcast_to(self.translation * np.eye(dim), (len(x), dim, dim))
        linear = [self.rotation * m for m in _skew(dim)] + [self.scale * np.eye(dim)] + [self.strain * m for m in _traceless(dim)]
        return np.concatenate([shift, np.stack([x @ m.T for m in linear], axis=2)], axis=2)

    def anchored(self, at: Array) -> Array:
        """Features (n, d, k d) of the anchors' shifts at positions (n, d)."""
        dim = at.shape[1]
        reach = np.exp(-0.5 * ((at[:, None] - self.anchors[None]) ** 2).sum(axis=2) / self.anchor_length**2)
        return np.einsum("nk,ab->nakb", reach, np.eye(dim)).reshape(len(at), dim, -1)


@dataclass(frozen=True)
class Observed:
    """Linear observations `directions . D(at)` (n, d), with `normal_part` (n,) = directions . N (zero where D has no normal field)."""

    at: Array
    directions: Array
    normal_part: Array


def grams(cov: Covariance, obs: Observed) -> tuple[Array, list[Array]]:
    """Fixed affine Gram matrix (n, n) and one unit-variance Gram matrix per tunable component."""
    fixed = np.einsum("na,nak->nk", obs.directions, cov.affine(obs.at))
    dots, sides = obs.directions @ obs.directions.T, np.outer(obs.normal_part, obs.normal_part)
    parts = [_matern(obs.at, obs.at, length) * dots for length in cov.vector]
    parts += [_matern(obs.at, obs.at, length) * sides for length in cov.normal]
    if len(cov.anchors):
        features = np.einsum("na,nak->nk", obs.directions, cov.anchored(obs.at))
        parts.append(features @ features.T)
    return fixed @ fixed.T, parts


def displacement(cov: Covariance, sds: Array, obs: Observed, alpha: Array, at: Array, normals: Array) -> Array:
    """Field (m, d) at positions `at` with reference `normals` (m, d), for observation weights alpha (n,) = C^-1 z."""
    fixed = np.einsum("na,nak,n->k", obs.directions, cov.affine(obs.at), alpha)
    field = cov.affine(at) @ fixed
    k = len(cov.lengths)
    pull = obs.directions * alpha[:, None]
    field += _field(at, normals, obs.at, pull, obs.normal_part * alpha, cov.lengths, sds[:k] ** 2, len(cov.vector))
    if len(cov.anchors):
        shifts = sds[k] ** 2 * np.einsum("na,nak,n->k", obs.directions, cov.anchored(obs.at), alpha)
        field += cov.anchored(at) @ shifts
    return np.asarray(field)


def cross(cov: Covariance, sds: Array, a: Observed, b: Observed) -> Array:
    """Covariance (n, m) between two sets of observations."""
    total = np.einsum("na,nak->nk", a.directions, cov.affine(a.at)) @ np.einsum("na,nak->nk", b.directions, cov.affine(b.at)).T
    dots, sides = a.directions @ b.directions.T, np.outer(a.normal_part, b.normal_part)
    for i, length in enumerate(cov.lengths):
        total += sds[i] ** 2 * _matern(a.at, b.at, length) * (dots if i < len(cov.vector) else sides)
    if len(cov.anchors):
        left, right = (np.einsum("na,nak->nk", o.directions, cov.anchored(o.at)) for o in (a, b))
        total += sds[-1] ** 2 * left @ right.T
    return np.asarray(total)


def variance(cov: Covariance, sds: Array, obs: Observed) -> Array:
    """Prior variance (n,) of the observations: the diagonal of `cross(obs, obs)`."""
    k, split = len(cov.lengths), len(cov.vector)
    total = (np.einsum("na,nak->nk", obs.directions, cov.affine(obs.at)) ** 2).sum(axis=1)
    total += (sds[:split] ** 2).sum() * (obs.directions**2).sum(axis=1) + (sds[split:k] ** 2).sum() * obs.normal_part**2
    if len(cov.anchors):
        total += sds[k] ** 2 * (np.einsum("na,nak->nk", obs.directions, cov.anchored(obs.at)) ** 2).sum(axis=1)
    return np.asarray(total)


def interpolation(nodes: Array, at: Array, length: float, neighbours: int = 8) -> tuple[Array, Array]:
    """Indices and weights (m, k) that interpolate a field of the given correlation length from nodes: local kriging."""
    from scipy.spatial import cKDTree

    _, near = cKDTree(nodes).query(at, k=min(neighbours, len(nodes)))
    near = near.reshape(len(at), -1)
    inner = _matern_of(np.linalg.norm(nodes[near][:, :, None] - nodes[near][:, None], axis=3) / length)
    outer = _matern_of(np.linalg.norm(nodes[near] - at[:, None], axis=2) / length)
    inner += 1e-6 * np.eye(near.shape[1])  # nodes can coincide; a millionth of the variance is far below any noise
    weights = np.linalg.solve(inner, outer[..., None])[..., 0]
    return near, weights / weights.sum(axis=1, keepdims=True)


def _matern_of(distance: Array) -> Array:
    s = SQRT5 * distance
    return np.asarray((1.0 + s + s * s / 3.0) * np.exp(-s))


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
    """Matern 5/2 correlation (n, m) of two point sets."""
    out = np.empty((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            r2 = 0.0
            for k in range(a.shape[1]):
                r2 += (a[i, k] - b[j, k]) ** 2
            s = SQRT5 * np.sqrt(r2) / length
            out[i, j] = (1.0 + s + s * s / 3.0) * np.exp(-s)
    return out


@njit(cache=True)
def _field(at, normals, sources, pull, push, lengths, variances, split):  # type: ignore[no-untyped-def]
    """Sum of Matern fields: `pull` (n, d) drives the vector kernels, `push` (n,) those along the normal."""
    m, dim = at.shape
    out = np.zeros((m, dim))
    for i in range(m):
        along = 0.0
        for j in range(sources.shape[0]):
            r2 = 0.0
            for k in range(dim):
                r2 += (at[i, k] - sources[j, k]) ** 2
            r = SQRT5 * np.sqrt(r2)
            free = 0.0
            for q in range(lengths.shape[0]):
                s = r / lengths[q]
                value = variances[q] * (1.0 + s + s * s / 3.0) * np.exp(-s)
                if q < split:
                    free += value
                else:
                    along += value * push[j]
            for k in range(dim):
                out[i, k] += free * pull[j, k]
        for k in range(dim):
            out[i, k] += along * normals[i, k]
    return out
