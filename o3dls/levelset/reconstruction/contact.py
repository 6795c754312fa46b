"""Who touches a wall that the points show themselves: each point is foretold by others, without it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ...arrays import Array
from .equations import Oriented, beside, field_through, off_prior
from .moved_prior import MovedPrior
from .settings import NormalSettings, ReconstructionSettings, SplineSettings
from .splines import SplineField

SEED = 20_261_125


def crowds_believed(
    points: Array, weights: Array, prior: MovedPrior, between: float, settings: ReconstructionSettings
) -> Array:
    """Probabilities of contact (n,) to begin with: those of the motion, but that crowds of doubted points are
    believed.

    A crowd is a wall that the moved prior does not reach, unless the prior's wall in front of it has points
    of its own: then it belongs to something else, as to another chamber.
    """
    doubted = np.flatnonzero(weights < 0.5)
    believed = weights >= 0.5
    if len(doubted) < settings.crowd or not believed.any():
        return weights
    reach = settings.crowd_reach * between
    pairs = KDTree(points[doubted]).query_pairs(reach, output_type="ndarray")
    links = csr_matrix((np.ones(len(pairs)), pairs.T), shape=(len(doubted), len(doubted)))
    _, crowd = connected_components(links, directed=False)
    feet = prior.tree.query(points[doubted])[2]
    covered = KDTree(points[believed]).query(feet)[0] < reach
    number = np.bincount(crowd)
    wall = (number >= settings.crowd) & (np.bincount(crowd, covered) < settings.covered * number)
    found = weights.copy()
    found[doubted[wall[crowd]]] = settings.crowd_weight
    return found


@dataclass(frozen=True)
class Scale:
    """Lengths of a reconstruction: rms radius of the prior, distance between points, spacing of the lattice
    of phi.
    """

    radius: float
    between: float
    spacing: float

    def lengths(self, noise: float, settings: SplineSettings) -> list[float]:
        """Widths of the lattices of splines, from coarse to fine."""
        finest = max(
            settings.finest_between * self.between,
            settings.finest_noise * noise,
            settings.finest_spacing * self.spacing,
        )
        coarsest = settings.coarsest * self.radius
        halvings = max(int(np.log2(coarsest / finest)), 0)
        return [coarsest / 2**k for k in range(halvings + 1)]


def distance_over(wall: Oriented, prior: MovedPrior, field: SplineField) -> Array:
    """Signed distance (n,) of points from the wall of a field."""
    return wall.heights + prior.at(wall.feet) + field.at(wall.feet)


def turned_along(wall: Oriented, prior: MovedPrior, field: SplineField, settings: NormalSettings) -> Oriented:
    """Points with the normals of the wall of a field, where it has one near their feet."""
    step = 1.5 * prior.spacing * np.eye(3)

    def phi(places: Array) -> Array:
        return prior.at(places) + field.at(places)

    rises = [phi(wall.feet + along) - phi(wall.feet - along) for along in step]
    slope = np.column_stack(rises) / (3.0 * prior.spacing)
    length = np.linalg.norm(slope, axis=1)
    steep = length > settings.least_slope
    normals = wall.normals.copy()
    normals[steep] = slope[steep] / length[steep, None]
    points = wall.feet + wall.heights[:, None] * wall.normals
    heights = ((points - wall.feet) * normals).sum(axis=1)
    return replace(wall, feet=points - heights[:, None] * normals, heights=heights, normals=normals)


def fitted(
    wall: Oriented, prior: MovedPrior, amplitude: float, scale: Scale, settings: ReconstructionSettings
) -> SplineField:
    """The field that the believed points ask for, of a deviation `amplitude`, larger where they lie off the
    moved prior.
    """
    chosen = settings.splines
    off = beside(wall, prior, scale.radius, chosen)
    largest = settings.amplitudes[-1] * scale.radius
    at = np.where(off_prior(wall, prior, chosen), max(amplitude, largest), amplitude)
    deviation = np.concatenate([at, np.full(len(off.at), max(amplitude, largest))])
    lengths = scale.lengths(float(np.median(wall.noise)), chosen)
    return field_through(wall, off, prior, deviation, lengths, chosen)


def foretold(
    wall: Oriented, prior: MovedPrior, amplitude: float, scale: Scale, settings: ReconstructionSettings
) -> Array:
    """Signed distance (n,) of each point, negative inside, from the wall that other points make.

    The points are split into parts; each is foretold by the others, or, of many points, a part foretells the
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
