"""Who touches a wall that the points show themselves: each point is predicted by others, without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ...arrays import Array
from ...noise.contact import Contact, contact_density
from ..field.equations import Oriented, floating, off_prior
from ..field.moved_prior import MovedPrior
from ..field.spline_fit import Scale, distance_over, fitted
from ..neighbours import SEED
from ..settings import ReconstructionSettings


def clusters_believed(
    points: Array, weights: Array, prior: MovedPrior, between: float, settings: ReconstructionSettings
) -> Array:
    """Return the probabilities of contact (n,) to begin with: those of the motion, but that clusters of
    doubted points are believed.

    A cluster is a wall that the moved prior does not reach, unless the prior's wall in front of it has points
    of its own: then it belongs to something else, as to another chamber.
    """
    doubted = np.flatnonzero(weights < 0.5)
    believed = weights >= 0.5
    if len(doubted) < settings.cluster or not believed.any():
        return weights
    reach = settings.cluster_reach * between
    pairs = KDTree(points[doubted]).query_pairs(reach, output_type="ndarray")
    links = csr_matrix((np.ones(len(pairs)), pairs.T), shape=(len(doubted), len(doubted)))
    _, cluster = connected_components(links, directed=False)
    feet = prior.tree.query(points[doubted])[2]
    covered = KDTree(points[believed]).query(feet)[0] < reach
    number = np.bincount(cluster)
    wall = (number >= settings.cluster) & (np.bincount(cluster, covered) < settings.covered * number)
    found = weights.copy()
    found[doubted[wall[cluster]]] = settings.cluster_weight
    return found


def left_out_distances(
    wall: Oriented, prior: MovedPrior, scale: Scale, settings: ReconstructionSettings
) -> Array:
    """Return the signed distance (n,) of each point, negative inside, from the wall that other points make;
    of points that float in front of the moved prior's wall, from that, if it is farther.

    The points are split into parts, none of them between points that may share an error; each is predicted by
    the others, or, of many points, a part predicts the rest.
    """
    count = len(wall.feet)
    apart, stretch = np.unique(wall.stretch, return_inverse=True)
    parts = max(settings.folds, int(np.ceil(count / settings.most_training)))
    parts = min(parts, max(len(apart), settings.folds))
    part = (np.random.default_rng(SEED).permutation(len(apart)) % parts)[stretch]
    total, times = np.zeros(count), np.zeros(count)
    for k in range(settings.folds):
        training = ((part == k) if parts > settings.folds else (part != k)) & (wall.weights > 0.5)
        tested = (part != k) if parts > settings.folds else (part == k)
        fewer = replace(scale, between=scale.between * np.sqrt(count / training.sum()))
        known = wall.of(training)
        lengths = fewer.lengths(known.noise, settings.splines)
        field = fitted(known, prior, fewer, settings, lengths)
        total[tested] += distance_over(wall.of(tested), prior, field)
        times[tested] += 1.0
    distance = total / times
    floats = floating(wall, prior, settings.splines)
    before = np.sqrt(prior.tree.query(wall.points[floats])[0])
    distance[floats] = -np.maximum(before, np.abs(distance[floats]))
    return distance


def gain_off_prior(
    wall: Oriented, prior: MovedPrior, left_out: Array, contact: Contact, settings: ReconstructionSettings
) -> float:
    """Return by how many nats believed points off the moved prior's wall are likelier as points of a wall
    that other points make, at signed distances left_out (n,), than with the moved prior, under which most are
    outliers. Each is given the noise that is best for it.
    """
    off = off_prior(wall, prior, settings.splines) & (wall.weights > 0.5)
    if not off.any():
        return 0.0

    def likely(residual: Array) -> float:
        floating = contact.outlier_fraction * contact.outlier_density(residual)
        touching = [
            contact_density(residual, (factor * wall.noise[off]) ** 2)
            for factor in settings.amplitude.noise_factors
        ]
        logs = [np.log((1.0 - contact.outlier_fraction) * density + floating) for density in touching]
        return max(float(wall.weights[off] @ log) for log in logs)

    return likely(left_out[off]) - likely((wall.heights + prior.at(wall.feet))[off])
