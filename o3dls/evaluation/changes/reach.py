"""How far a change reaches: which points of the second map lie in it, and where its border may lie.

By how much a point of the second map differs from what the first map tells of its place, x with the variance
v, is about 0 where nothing changed, and about the height h of the change in it:

    x ~ N(h, v + s^2) where f > 0,     x ~ N(0, v) elsewhere,     f ~ GP(0, 1 + exp(-d^2 / 2 l^2)).

h, s and how many points are in the change come from the points about it, by expectation-maximisation. f is
a latent process whose level is not known; its posterior is found by expectation propagation (Minka 2001;
Rasmussen and Williams 2006, section 3.6). Its samples are borders as likely as one another: the area of a
change is the mean of theirs. That of all places that are rather changed than not would be too small, since
small and thin parts are never likely, place by place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.special import expit, ndtr

from ...arrays import Array, Ints, Mask
from ...geometry.spread import spread
from ...motion.wall.nodes import NodeSums

CHANGE_LENGTH = 8.0  # mm, of a change and of the latent process
POINTS_IN, PLACES_IN = 3.0, 2.0  # lengths about a region: points that count, and places that may be of it
NODES = 500  # at which borders are drawn
SAMPLES = 100
ROUNDS = 20  # of expectation-maximisation
# sd of a change over its height, before points tell, and how many points that is worth
VARIED, AS_POINTS = 0.25, 3.0
SWEEPS, DAMPED, SETTLED = 60, 0.5, 1e-3  # of expectation propagation
SUREST = 30.0  # logarithm of odds; larger ones leave nothing that can be computed with
NUGGET = 1e-5


@dataclass(frozen=True, eq=False)
class Differences:
    """Differences are by how much k points at places (k, 6) of the second map differ (k,) from what the first
    tells of them, each with its variance (k,) where nothing changed; wall (n, 6): the places of the vertices.
    """

    wall: Array
    at: Array
    value: Array
    variance: Array


def draw_reach(
    faces: Ints, about: Mask, compared: Mask, seen: Differences, height: float, rng: np.random.Generator
) -> Mask:
    """Return at which vertices (s, n) a change may be that was found about some (n,) and has a height."""
    vertices = seen.wall
    found = cKDTree(vertices[about])
    some = found.query(seen.at)[0] < POINTS_IN * CHANGE_LENGTH
    odds = _weigh_points(seen.value[some], seen.variance[some], height)
    rows = np.flatnonzero(compared & (found.query(vertices)[0] < PLACES_IN * CHANGE_LENGTH))
    nodes = vertices[rows][spread(vertices[rows], NODES)]
    at_nodes = _draw_latent(seen.at[some], odds, nodes, rng)
    latent = NodeSums.of(nodes, vertices[rows], CHANGE_LENGTH).values(at_nodes[:, :, None])[:, :, 0]
    inside = np.zeros((len(latent), len(vertices)), dtype=bool)
    inside[:, rows] = latent > 0.0
    return np.array([_keep_about(faces, one, about) for one in inside])


def _weigh_points(value: Array, variance: Array, height: float) -> Array:
    """Return the logarithm (k,) of how much likelier the value of each point is in the change than beside."""
    first, own, share = height, (VARIED * height) ** 2, 0.5
    for _ in range(ROUNDS):
        spread_over = variance + own
        odds = 0.5 * (
            value**2 / variance - (value - height) ** 2 / spread_over - np.log(spread_over / variance)
        )
        inside = expit(odds + np.log(share / (1.0 - share)))
        count = inside.sum() + AS_POINTS
        height = float((inside @ value + AS_POINTS * first) / count)
        own = float((inside @ (value - height) ** 2 + AS_POINTS * (VARIED * first) ** 2) / count)
        share = float((inside.sum() + 1.0) / (len(value) + 2.0))
    return np.asarray(odds)


def _draw_latent(at: Array, odds: Array, nodes: Array, rng: np.random.Generator) -> Array:
    """Return samples (s, m) of the latent process at nodes (m, 6), by points at (k, 6) with odds (k,)."""
    own, crossed, joint = (_correlate(a, b) for a, b in ((at, at), (at, nodes), (nodes, nodes)))
    precision, pull = _propagate(own, np.sign(odds), expit(-np.minimum(np.abs(odds), SUREST)))
    root = np.sqrt(precision)
    factor = np.linalg.cholesky(np.eye(len(at)) + root[:, None] * own * root)
    seen = solve_triangular(factor, root[:, None] * crossed, lower=True)
    mean = crossed.T @ pull - seen.T @ solve_triangular(factor, root * (own @ pull), lower=True)
    left = joint - seen.T @ seen
    left[np.diag_indices_from(left)] += NUGGET * joint[0, 0]
    return np.asarray(mean + rng.standard_normal((SAMPLES, len(nodes))) @ np.linalg.cholesky(left).T)


def _correlate(a: Array, b: Array) -> Array:
    return np.asarray(1.0 + np.exp(-0.5 * cdist(a, b, "sqeuclidean") / CHANGE_LENGTH**2))


def _propagate(covariance: Array, sign: Array, doubt: Array) -> tuple[Array, Array]:
    """Return precision (k,) and precision times mean (k,) of the normal factors that stand for what points
    say: f has the sign (k,), but for a doubt (k,).
    """
    count = len(sign)
    precision, pull = np.full(count, 1e-6), np.zeros(count)
    for _ in range(SWEEPS):
        whole = cho_factor(covariance + np.diag(1.0 / precision), lower=True)
        variance = np.diag(covariance) - np.einsum("ij,ji->i", covariance, cho_solve(whole, covariance))
        mean = covariance @ cho_solve(whole, pull / precision)
        left = 1.0 / np.maximum(1.0 / variance - precision, 1e-9)  # without the point's own factor
        centre = left * (mean / variance - pull)
        z = sign * centre / np.sqrt(left + NUGGET)
        clear = (1.0 - 2.0 * doubt) * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
        slope = clear / (doubt + (1.0 - 2.0 * doubt) * ndtr(z) + 1e-300)
        bend = slope * (slope + z)
        narrower = left * (1.0 - np.clip(bend, 1e-6, 1.0 - 1e-6) * left / (left + NUGGET))
        moved = centre + left * sign * slope / np.sqrt(left + NUGGET)
        new = np.maximum(1.0 / narrower - 1.0 / left, 1e-6)
        change = DAMPED * (new - precision)
        pull = pull + DAMPED * (moved * (new + 1.0 / left) - centre / left - pull)
        precision = precision + change
        if np.abs(change).max() < SETTLED * precision.max():
            break
    return precision, pull


def _keep_about(faces: Ints, inside: Mask, about: Mask) -> Mask:
    """Return what of some vertices (n,) hangs together with where the change was found."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = edges[inside[edges].all(axis=1)]
    graph = sparse.coo_array((np.ones(len(edges)), edges.T), shape=(len(inside), len(inside)))
    part = connected_components(graph, directed=False)[1]
    return np.asarray(inside & np.isin(part, part[inside & about]))
