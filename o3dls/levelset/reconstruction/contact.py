"""Who touches a wall that the points show themselves: each point is predicted by others, without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ...arrays import Array
from .equations import Oriented
from .fitting import Scale, distance_over, fitted
from .moved_prior import MovedPrior
from .normals import SEED
from .settings import ReconstructionSettings


def clusters_believed(
    points: Array, weights: Array, prior: MovedPrior, between: float, settings: ReconstructionSettings
) -> Array:
    """Probabilities of contact (n,) to begin with: those of the motion, but that clusters of doubted points
    are believed.

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
    wall: Oriented, prior: MovedPrior, amplitude: float, scale: Scale, settings: ReconstructionSettings
) -> Array:
    """Signed distance (n,) of each point, negative inside, from the wall that other points make.

    The points are split into parts; each is predicted by the others, or, of many points, a part predicts the
    rest.
    """
    count = len(wall.feet)
    parts = max(settings.folds, int(np.ceil(count / settings.most_training)))
    part = np.random.default_rng(SEED).permutation(count) % parts
    total, times = np.zeros(count), np.zeros(count)
    for k in range(settings.folds):
        training = ((part == k) if parts > settings.folds else (part != k)) & (wall.weights > 0.5)
        tested = (part != k) if parts > settings.folds else (part == k)
        fewer = replace(scale, between=scale.between * np.sqrt(count / training.sum()))
        field = fitted(wall.of(training), prior, amplitude, fewer, settings)
        total[tested] += distance_over(wall.of(tested), prior, field)
        times[tested] += 1.0
    return total / times
