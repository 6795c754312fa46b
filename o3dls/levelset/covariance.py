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
from ..registration import pose
from .compiled import by_rows

SQRT5 = 5.0**0.5
WORTH = 500  # places that are worth a thread


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
        return np.asarray(np.einsum("gij,nj->nig", pose.turns(at.shape[1]), at - self.centre))

    def tunable(self, at: Array) -> list[Array]:
        """Features (n, d, k) of bends, strains and, where there are any, tilts and shifts of the anchors, for unit standard deviations."""
        x, turns = at - self.centre, self.turns(at)
        bends = np.concatenate([turns * x[:, None, j : j + 1] / self.radius for j in range(x.shape[1])], axis=2)
        strains = np.einsum("gij,nj->nig", pose.traceless(at.shape[1]), x)
        found = [bends, strains]
        if self.up is not None:
            found.append(turns * np.tanh(x @ self.up / self.radius)[:, None, None])
        return [*found, self._anchored(at)] if len(self.anchors) else found

    def features(self, at: Array) -> list[Array]:
        """All of these, the similarity's first."""
        return [self.similarity(at), *self.tunable(at)]

    def whole_sds(self, sds: Array) -> Array:
        """Standard deviations of the features: one for the similarity, whose features have their own, and one per tunable component."""
        return np.concatenate([[1.0], sds[len(self.lengths) :]])

    def smooth(self, sds: Array) -> tuple[Array, Array]:
        """Correlation lengths (l,), and for each the variances (l, 2) of its fields: of vectors, and along the normal."""
        lengths, which = np.unique(self.lengths, return_inverse=True)
        along = np.arange(len(which)) >= len(self.vector)
        variances = np.zeros((len(lengths), 2))
        np.add.at(variances, (which, along.astype(int)), sds[: len(which)] ** 2)
        return lengths, variances

    def _anchored(self, at: Array) -> Array:
        dim = at.shape[1]
        reach = np.exp(-0.5 * ((at[:, None] - self.anchors[None]) ** 2).sum(axis=2) / self.anchor_length**2)
        return np.asarray(np.einsum("nk,ab->nakb", reach, np.eye(dim)).reshape(len(at), dim, -1))


@dataclass(frozen=True)
class Observed:
    """Linear observations `directions . D(at)` (n, d), with `normal_part` (n,) = directions . N (zero where D has no field along it);
    and the covariance's features there, if they are at hand."""

    at: Array
    directions: Array
    normal_part: Array
    features: list[Array] | None = None


@dataclass(frozen=True)
class Places:
    """Places on the posed prior: positions (m, d) and the unit normals N (m, d) along which it likes to move; features as in `Observed`."""

    at: Array
    normals: Array
    features: list[Array] | None = None

    def observed(self, directions: Array) -> Observed:
        return Observed(self.at, directions, (self.normals * directions).sum(axis=1), self.features)


def grams(cov: Covariance, obs: Observed) -> tuple[Array, list[Array]]:
    """Gram matrix (n, n) of the similarity part and one of unit variance per tunable component."""
    dots, sides = obs.directions @ obs.directions.T, np.outer(obs.normal_part, obs.normal_part)
    correlation = {length: _matern(obs.at, obs.at, length) for length in {*cov.vector, *cov.normal}}
    parts = [correlation[length] * dots for length in cov.vector] + [correlation[length] * sides for length in cov.normal]
    fixed, *wholes = (seen @ seen.T for seen in _seen(cov, obs))
    return fixed, parts + wholes


def displacement(cov: Covariance, sds: Array, obs: Observed, alpha: Array, places: Places) -> Array:
    """Field (m, d) at `places`, for observation weights alpha (n,) = C^-1 z."""
    whole = np.zeros(places.at.size)
    for sd, here, there in zip(cov.whole_sds(sds), _features(cov, places), _seen(cov, obs), strict=True):
        whole += here.reshape(-1, here.shape[2]) @ (sd**2 * (alpha @ there))
    lengths, variances = cov.smooth(sds)
    smooth = np.zeros((len(places.at), places.at.shape[1] + 1))
    pulls = np.ascontiguousarray(np.swapaxes(alpha[:, None] * _pulls(obs, variances), 1, 2))
    by_rows(_correlated, WORTH, (places.at, smooth), obs.at, lengths, pulls)
    return np.asarray(whole.reshape(places.at.shape) + smooth[:, :-1] + smooth[:, -1:] * places.normals)


def cross(cov: Covariance, sds: Array, a: Observed, b: Observed) -> Array:
    """Covariance (n, m) between two sets of observations."""
    left = np.hstack([sd**2 * seen for sd, seen in zip(cov.whole_sds(sds), _seen(cov, a), strict=True)])
    total = left @ np.hstack(_seen(cov, b)).T
    lengths, variances = cov.smooth(sds)
    for length, pulls in zip(lengths, _pulls(a, variances), strict=True):
        shared = pulls @ np.column_stack([b.directions, b.normal_part]).T
        shared *= _matern(a.at, b.at, length)
        total += shared
    return np.asarray(total)


def variance(cov: Covariance, sds: Array, obs: Observed) -> Array:
    """Prior variance (n,) of the observations: the diagonal of `cross(obs, obs)`."""
    k, split = len(cov.lengths), len(cov.vector)
    total = (sds[:split] ** 2).sum() * (obs.directions**2).sum(axis=1) + (sds[split:k] ** 2).sum() * obs.normal_part**2
    for sd, seen in zip(cov.whole_sds(sds), _seen(cov, obs), strict=True):
        total += sd**2 * (seen**2).sum(axis=1)
    return np.asarray(total)


def interpolation(nodes: Array, at: Array, length: float, neighbours: int = 8) -> sparse.csr_matrix:
    """Matrix (m, nodes) that interpolates a field of the given correlation length at places `at` (m, d) from nodes: local kriging."""
    k = min(neighbours, len(nodes))
    near = cKDTree(nodes).query(at, k=k)[1].reshape(len(at), k)
    begin = np.arange(0, near.size + 1, k)
    weights = np.empty(near.shape)
    by_rows(_kriging, WORTH, (at, near, weights), nodes, length)
    return sparse.csr_matrix((weights.ravel(), near.ravel(), begin), shape=(len(at), len(nodes)))


def _seen(cov: Covariance, obs: Observed) -> list[Array]:
    """Features as the observations see them: along their directions, (n, k) each."""
    return [np.einsum("na,nak->nk", obs.directions, features) for features in _features(cov, obs)]


def _features(cov: Covariance, where: Observed | Places) -> list[Array]:
    return cov.features(where.at) if where.features is None else where.features


def _pulls(obs: Observed, variances: Array) -> Array:
    """How the observations pull at fields of every correlation length, of vectors and along the normal: (l, n, d + 1)."""
    dim = obs.at.shape[1]
    return np.asarray(np.repeat(variances, [dim, 1], axis=1)[:, None] * np.column_stack([obs.directions, obs.normal_part]))


@njit(cache=True)
def _matern(a, b, length):  # type: ignore[no-untyped-def]
    """Matern 5/2 correlation (n, m) of two point sets, within 1e-11."""
    out, squared, columns = np.empty((a.shape[0], b.shape[0])), np.empty(b.shape[0]), np.ascontiguousarray(b.T)
    for i in range(a.shape[0]):
        _squared_distances(a[i], columns, squared)
        _decay(squared, SQRT5 / length, out[i])
    return out


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _correlated(a, out, b, lengths, values):  # type: ignore[no-untyped-def]
    """Add to out (n, q), over lengths (l,), the correlations (n, m) times values (l, q, m); of those no more than a row is in memory."""
    n, m, q = a.shape[0], b.shape[0], values.shape[1]
    squared, row, columns = np.empty(m), np.empty(m), np.ascontiguousarray(b.T)
    for i in range(n):
        _squared_distances(a[i], columns, squared)
        for k in range(len(lengths)):
            _decay(squared, SQRT5 / lengths[k], row)
            for c in range(q):
                total = 0.0
                for j in range(m):
                    total += row[j] * values[k, c, j]
                out[i, c] += total


@njit(cache=True, inline="always")
def _squared_distances(place, columns, out):  # type: ignore[no-untyped-def]
    """Write the squared distances (m,) of a place (d,) from the columns (d, m)."""
    out[:] = 0.0
    for k in range(columns.shape[0]):
        for j in range(columns.shape[1]):
            out[j] += (place[k] - columns[k, j]) ** 2


@njit(cache=True, inline="always")
def _decay(squared, scale, out):  # type: ignore[no-untyped-def]
    """Write the correlations (m,) at squared distances (m,) times scale^2.

    Plain loops and a polynomial for the exponential, exp(-s) = exp(-s / 256)^256, because a compiler turns these into vector
    instructions, and calls of exp it does not: ten times faster.
    """
    for j in range(len(squared)):
        s = min(scale * np.sqrt(squared[j]), 40.0)  # beyond, nothing is left
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
def _kriging(at, near, weights, nodes, length):  # type: ignore[no-untyped-def]
    """Fill in weights (m, k), summing to one, of the nodes (m, k) near each place: correlations among them solved for those with it.

    By Cholesky's factorisation written out: on so small a system a library's call takes longer than its arithmetic.
    """
    m, k = near.shape
    here = np.empty((k + 1, nodes.shape[1]))
    for i in range(m):
        w = weights[i]
        for c in range(here.shape[1]):  # a slice assigned would compile for seconds
            for j in range(k):
                here[j, c] = nodes[near[i, j], c]
            here[k, c] = at[i, c]
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
