"""Prior covariance of the motion field: what displacements of the prior are likely, before any point is seen.

D(r) = A(r) b + S(r) e + w(r) x (r - centre) + f(r) N(r) q + sum_k u_k(r) + N(r) sum_k g_k(r) + sum_L exp(-|r-L|^2 / 2 l_a^2) c_L
at positions r of the posed prior. A b: translation, rotation and scale, nearly free; S e: traceless strains; w: a rotation that
changes over the chamber, so that bending and twisting are cheap; q: the share of the prior's roughness that the wall has not
(`fairing`); u, g: Matern 5/2 fields, of vectors and along the normal N (order >= 2: point data have no hold on rougher fields over
a surface); c_L: shifts of anchors (vein ostia), each its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ..geometry import Array, Ints

SQRT5 = 5.0**0.5


@dataclass(frozen=True)
class Covariance:
    """Components of the field's covariance; their standard deviations come as one array: vector, normal, bend, fairing, strain, anchors.

    centre (d,) is the origin of the similarity part, whose own standard deviations are translation (a length), rotation (rad)
    and scale; vector, normal and bend are correlation lengths; anchors (k, d) reach as far as anchor_length.
    """

    centre: Array
    vector: tuple[float, ...]
    normal: tuple[float, ...]
    bend: float
    anchors: Array
    anchor_length: float
    translation: float
    rotation: float = 0.1
    scale: float = 0.1

    @property
    def lengths(self) -> Array:
        return np.array(self.vector + self.normal)

    @property
    def fairing_at(self) -> int:
        """Where the standard deviation of fairing stands among those of the components."""
        return len(self.lengths) + 1

    def similarity(self, at: Array) -> Array:
        """Features (n, d, k) of the similarity part at positions (n, d), each scaled to unit variance."""
        x, dim = at - self.centre, at.shape[1]
        shift = np.broadcast_to(self.translation * np.eye(dim), (len(x), dim, dim))
        return np.concatenate([shift, self.rotation * self.turns(at), self.scale * x[:, :, None]], axis=2)

    def turns(self, at: Array) -> Array:
        """Features (n, d, k) of unit rotations about the centre."""
        return np.stack([(at - self.centre) @ m.T for m in _skew(at.shape[1])], axis=2)

    def tunable(self, at: Array) -> list[Array]:
        """Features (n, d, k) of strains and, where there are any, of the anchors' shifts, for unit standard deviations."""
        strains = np.stack([(at - self.centre) @ m.T for m in _traceless(at.shape[1])], axis=2)
        return [strains, self._anchored(at)] if len(self.anchors) else [strains]

    def _anchored(self, at: Array) -> Array:
        dim = at.shape[1]
        reach = np.exp(-0.5 * ((at[:, None] - self.anchors[None]) ** 2).sum(axis=2) / self.anchor_length**2)
        return np.asarray(np.einsum("nk,ab->nakb", reach, np.eye(dim)).reshape(len(at), dim, -1))


@dataclass(frozen=True)
class Observed:
    """Linear observations `directions . D(at)` (n, d), with `normal_part` (n,) = directions . N and `fairing_part` (n,) =
    directions . f N (both zero where D has no field along the normal).
    """

    at: Array
    directions: Array
    normal_part: Array
    fairing_part: Array


@dataclass(frozen=True)
class Places:
    """Places on the posed prior: positions (m, d), its unit normals N (m, d), and how far f (m,) fairing would move it along them."""

    at: Array
    normals: Array
    fairing: Array

    def observed(self, directions: Array) -> Observed:
        along = (self.normals * directions).sum(axis=1)
        return Observed(self.at, directions, along, along * self.fairing)


def grams(cov: Covariance, obs: Observed) -> tuple[Array, list[Array]]:
    """Gram matrix (n, n) of the similarity part and one of unit variance per tunable component."""
    fixed = _seen(obs, cov.similarity(obs.at))
    dots, sides = obs.directions @ obs.directions.T, np.outer(obs.normal_part, obs.normal_part)
    correlation = {length: _matern(obs.at, obs.at, length) for length in {*cov.vector, *cov.normal}}
    parts = [correlation[length] * dots for length in cov.vector] + [correlation[length] * sides for length in cov.normal]
    turns = _seen(obs, cov.turns(obs.at))
    parts += [_matern(obs.at, obs.at, cov.bend) * (turns @ turns.T), np.outer(obs.fairing_part, obs.fairing_part)]
    parts += [f @ f.T for f in (_seen(obs, features) for features in cov.tunable(obs.at))]
    return fixed @ fixed.T, parts


def displacement(cov: Covariance, sds: Array, obs: Observed, alpha: Array, places: Places) -> Array:
    """Field (m, d) at `places`, for observation weights alpha (n,) = C^-1 z."""
    at, normals = places.at, places.normals
    field = cov.similarity(at) @ (alpha @ _seen(obs, cov.similarity(obs.at)))
    k, split = len(cov.lengths), len(cov.vector)
    lengths, which = np.unique(cov.lengths, return_inverse=True)  # fields of one length share its exponential
    free = np.bincount(which[:split], sds[:split] ** 2, minlength=len(lengths))
    along = np.bincount(which[split:], sds[split:k] ** 2, minlength=len(lengths))
    field += _field(at, normals, obs.at, obs.directions * alpha[:, None], obs.normal_part * alpha, lengths, free, along)
    turning = _matern(at, obs.at, cov.bend) @ (alpha[:, None] * _seen(obs, cov.turns(obs.at)))
    field += sds[k] ** 2 * np.einsum("nak,nk->na", cov.turns(at), turning)
    field += sds[k + 1] ** 2 * (alpha @ obs.fairing_part) * places.fairing[:, None] * normals
    for sd, here, there in zip(sds[k + 2 :], cov.tunable(at), cov.tunable(obs.at), strict=True):
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
    total += sds[k] ** 2 * _matern(a.at, b.at, cov.bend) * (_seen(a, cov.turns(a.at)) @ _seen(b, cov.turns(b.at)).T)
    total += sds[k + 1] ** 2 * np.outer(a.fairing_part, b.fairing_part)
    for sd, left, right in zip(sds[k + 2 :], cov.tunable(a.at), cov.tunable(b.at), strict=True):
        total += sd**2 * _seen(a, left) @ _seen(b, right).T
    return np.asarray(total)


def variance(cov: Covariance, sds: Array, obs: Observed) -> Array:
    """Prior variance (n,) of the observations: the diagonal of `cross(obs, obs)`."""
    k, split = len(cov.lengths), len(cov.vector)
    total = (_seen(obs, cov.similarity(obs.at)) ** 2).sum(axis=1)
    total += (sds[:split] ** 2).sum() * (obs.directions**2).sum(axis=1) + (sds[split:k] ** 2).sum() * obs.normal_part**2
    total += sds[k] ** 2 * (_seen(obs, cov.turns(obs.at)) ** 2).sum(axis=1)
    total += sds[k + 1] ** 2 * obs.fairing_part**2
    for sd, features in zip(sds[k + 2 :], cov.tunable(obs.at), strict=True):
        total += sd**2 * (_seen(obs, features) ** 2).sum(axis=1)
    return np.asarray(total)


def interpolation(nodes: Array, at: Array, length: float, neighbours: int = 8) -> tuple[Ints, Array]:
    """Indices and weights (m, k) that interpolate a field of the given correlation length from nodes: local kriging."""
    from scipy.spatial import cKDTree

    _, near = cKDTree(nodes).query(at, k=min(neighbours, len(nodes)))
    near = near.reshape(len(at), -1)
    inner = _matern_of(np.linalg.norm(nodes[near][:, :, None] - nodes[near][:, None], axis=3) / length)
    outer = _matern_of(np.linalg.norm(nodes[near] - at[:, None], axis=2) / length)
    inner += 1e-6 * np.eye(near.shape[1])  # nodes can coincide; a millionth of the variance is far below any noise
    weights = np.linalg.solve(inner, outer[..., None])[..., 0]
    return np.asarray(near, dtype=np.int64), np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _seen(obs: Observed, features: Array) -> Array:
    """Features (n, d, k) as the observations see them: along their directions, (n, k)."""
    return np.asarray(np.einsum("na,nak->nk", obs.directions, features))


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
def _field(at, normals, sources, pull, push, lengths, free, along):  # type: ignore[no-untyped-def]
    """Sum of Matern fields: `pull` (n, d) drives those with variances `free`, `push` (n,) those with variances `along` the normal."""
    m, dim = at.shape
    out = np.zeros((m, dim))
    for i in range(m):
        out_along = 0.0
        for j in range(sources.shape[0]):
            r2 = 0.0
            for k in range(dim):
                r2 += (at[i, k] - sources[j, k]) ** 2
            r = SQRT5 * np.sqrt(r2)
            toward = 0.0
            for q in range(lengths.shape[0]):
                s = r / lengths[q]
                value = (1.0 + s + s * s / 3.0) * np.exp(-s)
                toward += free[q] * value
                out_along += along[q] * value * push[j]
            for k in range(dim):
                out[i, k] += toward * pull[j, k]
        for k in range(dim):
            out[i, k] += out_along * normals[i, k]
    return out
