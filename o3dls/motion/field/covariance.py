"""Prior covariance of the motion field: what displacements of the prior are likely, before any point is seen.

D(r) = A(r) b + S(r) e + w(r) x (r - centre) + sum_k u_k(r) + N(r) sum_k g_k(r) + sum_L M(|r-L| / l_a) c_L
at positions r of the posed prior. A b: translation, rotation and scale, nearly free; S e: traceless strains;
w = B (r - centre) / radius: a rotation that changes over the chamber, so that bending and twisting are cheap;
u, g: Matern 5/2 fields, of vectors and along the normal N (order >= 2: point data have no hold on rougher
fields over a surface); c_L: shifts of anchors (vein ostia), each its own, which M, Matern 5/2 too, carries
around them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ...arrays import Array
from ...geometry import twist as pose
from ...parallel import by_rows
from .kernels import add_correlated, add_covariance, kriging_weights, matern

WORTH = 500  # places that are worth a thread


@dataclass(frozen=True)
class Covariance:
    """A covariance has the components of the motion field's; their standard deviations come as one array:
    vector, normal, bend, strain, anchors.

    centre (d,) is the origin of the similarity part, whose own standard deviations are translation (a
    length), rotation (rad) and scale; vector and normal are correlation lengths; a bend is measured by how
    far one turns over `radius`; shifts of anchors (k, d) are correlated over anchor_length.
    """

    centre: Array
    vector: tuple[float, ...]
    normal: tuple[float, ...]
    radius: float
    anchors: Array
    anchor_length: float
    translation: float
    rotation: float
    scale: float

    @property
    def lengths(self) -> Array:
        return np.array(self.vector + self.normal)

    def similarity(self, at: Array) -> Array:
        """Return the features (n, d, k) of the similarity part at positions (n, d), each scaled to unit
        variance.
        """
        x = at - self.centre
        dim = at.shape[1]
        shift = np.broadcast_to(self.translation * np.eye(dim), (len(x), dim, dim))
        return np.concatenate([shift, self.rotation * self.turns(at), self.scale * x[:, :, None]], axis=2)

    def turns(self, at: Array) -> Array:
        """Return features (n, d, k) of unit rotations about the centre."""
        return np.asarray(np.einsum("gij,nj->nig", pose.turns(at.shape[1]), at - self.centre))

    def tunable(self, at: Array) -> list[Array]:
        """Return the features (n, d, k) of bends, strains and, where there are any, shifts of the anchors,
        for unit standard deviations.
        """
        x = at - self.centre
        turns = self.turns(at)
        bends = np.concatenate(
            [turns * x[:, None, j : j + 1] / self.radius for j in range(x.shape[1])], axis=2
        )
        strains = np.einsum("gij,nj->nig", pose.traceless(at.shape[1]), x)
        found = [bends, strains]
        return [*found, self._anchor_features(at)] if len(self.anchors) else found

    def features(self, at: Array) -> list[Array]:
        """Return all features, those of the similarity first."""
        return [self.similarity(at), *self.tunable(at)]

    def whole_sds(self, sds: Array) -> Array:
        """Return the standard deviations of the features: one for the similarity, whose features have their
        own, and one per tunable component.
        """
        return np.concatenate([[1.0], sds[len(self.lengths) :]])

    def smooth(self, sds: Array) -> tuple[Array, Array]:
        """Return the correlation lengths (l,), and for each the variances (l, 2) of its fields: of vectors,
        and along the normal.
        """
        lengths, which = np.unique(self.lengths, return_inverse=True)
        along = np.arange(len(which)) >= len(self.vector)
        variances = np.zeros((len(lengths), 2))
        np.add.at(variances, (which, along.astype(int)), sds[: len(which)] ** 2)
        return lengths, variances

    def _anchor_features(self, at: Array) -> Array:
        dim = at.shape[1]
        reach = matern(at, self.anchors, self.anchor_length)
        return np.asarray(np.einsum("nk,ab->nakb", reach, np.eye(dim)).reshape(len(at), dim, -1))


@dataclass(frozen=True)
class Observed:
    """These are linear observations `directions . D(at)` (n, d), with `normal_part` (n,) = directions . N
    (zero where D has no field along it), and the covariance's features there, if they are at hand.
    """

    at: Array
    directions: Array
    normal_part: Array
    features: list[Array] | None = None


@dataclass(frozen=True)
class Places:
    """Places lie on the posed prior: positions (m, d) and the unit normals N (m, d) along which it likes to
    move; features as in `Observed`.
    """

    at: Array
    normals: Array
    features: list[Array] | None = None

    def observed(self, directions: Array) -> Observed:
        return Observed(self.at, directions, (self.normals * directions).sum(axis=1), self.features)


def grams(cov: Covariance, obs: Observed) -> tuple[Array, list[Array]]:
    """Return the Gram matrix (n, n) of the similarity part and one of unit variance per tunable component."""
    dots = obs.directions @ obs.directions.T
    sides = np.outer(obs.normal_part, obs.normal_part)
    correlation = {length: matern(obs.at, obs.at, length) for length in {*cov.vector, *cov.normal}}
    parts = [correlation[length] * dots for length in cov.vector] + [
        correlation[length] * sides for length in cov.normal
    ]
    fixed, *wholes = (seen @ seen.T for seen in _observe_features(cov, obs))
    return fixed, parts + wholes


@dataclass(frozen=True, eq=False)
class FieldPrior:
    """The field before any point is seen: a covariance with the standard deviations of its components."""

    covariance: Covariance
    sds: Array

    def between(self, a: Observed, b: Observed) -> Array:
        """Return the covariance (n, m) between two sets of observations."""
        cov = self.covariance
        seen = _observe_features(cov, a)
        left = np.hstack([sd**2 * one for sd, one in zip(cov.whole_sds(self.sds), seen, strict=True)])
        total = left @ np.hstack(seen if b is a else _observe_features(cov, b)).T
        lengths, variances = cov.smooth(self.sds)
        pulls = np.ascontiguousarray(np.moveaxis(_pull_on_fields(a, variances), 0, 1))
        others = np.ascontiguousarray(np.column_stack([b.directions, b.normal_part]).T)
        by_rows(add_covariance, WORTH, (a.at, pulls, total), b.at, others, lengths)
        return np.asarray(total)

    def variance(self, obs: Observed) -> Array:
        """Return the variance (n,) of the observations: the diagonal of `between(obs, obs)`."""
        cov, sds = self.covariance, self.sds
        k, split = len(cov.lengths), len(cov.vector)
        total = (sds[:split] ** 2).sum() * (obs.directions**2).sum(axis=1) + (
            sds[split:k] ** 2
        ).sum() * obs.normal_part**2
        for sd, seen in zip(cov.whole_sds(sds), _observe_features(cov, obs), strict=True):
            total += sd**2 * (seen**2).sum(axis=1)
        return np.asarray(total)

    def displacement(self, obs: Observed, alpha: Array, places: Places) -> Array:
        """Return the field (m, d) at places that observations pull with weights alpha (n,)."""
        cov = self.covariance
        whole = np.zeros(places.at.size)
        for sd, here, there in zip(
            cov.whole_sds(self.sds), _features_at(cov, places), _observe_features(cov, obs), strict=True
        ):
            whole += here.reshape(-1, here.shape[2]) @ (sd**2 * (alpha @ there))
        lengths, variances = cov.smooth(self.sds)
        smooth = np.zeros((len(places.at), places.at.shape[1] + 1))
        pulls = np.ascontiguousarray(np.swapaxes(alpha[:, None] * _pull_on_fields(obs, variances), 1, 2))
        by_rows(add_correlated, WORTH, (places.at, smooth), obs.at, lengths, pulls)
        return np.asarray(whole.reshape(places.at.shape) + smooth[:, :-1] + smooth[:, -1:] * places.normals)


def interpolation(nodes: Array, at: Array, length: float, neighbours: int) -> sparse.csr_matrix:
    """Return the matrix (m, nodes) that interpolates a field of the given correlation length at places `at`
    (m, d) from nodes: local kriging.
    """
    k = min(neighbours, len(nodes))
    near = cKDTree(nodes).query(at, k=k)[1].reshape(len(at), k)
    begin = np.arange(0, near.size + 1, k)
    weights = np.empty(near.shape)
    by_rows(kriging_weights, WORTH, (at, near, weights), nodes, length)
    return sparse.csr_matrix((weights.ravel(), near.ravel(), begin), shape=(len(at), len(nodes)))


def _observe_features(cov: Covariance, obs: Observed) -> list[Array]:
    """Return the features (n, k) as the observations see them, along their directions."""
    return [np.einsum("na,nak->nk", obs.directions, features) for features in _features_at(cov, obs)]


def _features_at(cov: Covariance, where: Observed | Places) -> list[Array]:
    return cov.features(where.at) if where.features is None else where.features


def _pull_on_fields(obs: Observed, variances: Array) -> Array:
    """Return how the observations pull at fields of every correlation length, of vectors and along the
    normal: (l, n, d + 1).
    """
    dim = obs.at.shape[1]
    return np.asarray(
        np.repeat(variances, [dim, 1], axis=1)[:, None] * np.column_stack([obs.directions, obs.normal_part])
    )
