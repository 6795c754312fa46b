"""Who touches a wall that the points show themselves: each point is predicted by others, without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Array
from ...noise.contact import Contact, contact_density
from ..field.equations import Oriented, floating, off_prior
from ..field.moved_prior import MovedPrior
from ..field.spline_fit import Scale, distance_over, fitted
from ..neighbours import SEED
from ..settings import ReconstructionSettings


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
