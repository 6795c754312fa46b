"""phi as the moved prior's signed distance plus a field that the points ask for.

phi = psi.T + g, with g smooth and small before points are seen: near points phi follows them, as a
reconstruction of the points alone would; where there are none it is the moved prior. Which points belong to
the wall is asked of the points themselves (`contact`), on which side of them is inside of all of them
together (`normals`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import ROUNDING, Array
from ...geometry.similarity import rms_radius
from ...geometry.surface import Surface
from ...noise.contact import Contact, update_contact
from ...parallel import one_blas_thread
from .contact import clusters_believed, left_out_distances
from .equations import Oriented, off_prior
from .fitting import Scale, distance_over, fitted, phi_at, turned_along
from .moved_prior import MovedPrior
from .normals import nearest, planes, turned_outward
from .settings import ReconstructionSettings
from .splines import SplineField

NEAREST = 8  # points whose distance tells how much of the wall a point stands for


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A field g on the moved prior, the points that it follows, their noise, how likely (n,) each touches,
    and by how many nats it predicts points better than the moved prior alone; rms radius of the prior,
    distance between points, widths of the field's lattices.
    """

    prior: MovedPrior
    field: SplineField
    wall: Oriented
    sigma: float
    weights: Array
    amplitude: float
    gain: float
    radius: float
    between: float
    lengths: list[float]


@dataclass(frozen=True, eq=False)
class Believed:
    """Points (n, 3) as a motion left them: probabilities of contact (n,), noise (n,), factors (n,) on the
    odds of being an outlier, and the mixture.
    """

    points: Array
    weights: Array
    noise: Array
    odds: Array
    contact: Contact


@one_blas_thread()
def reconstruct(
    surface: Surface, believed: Believed, spacing: float, settings: ReconstructionSettings
) -> Reconstruction | None:
    """Reconstruct the wall from points on top of a moved prior, a closed surface; None where that predicts
    points no better than the moved prior does.

    spacing: of the lattice of phi.
    """
    points, noise, contact = believed.points, believed.noise, believed.contact
    radius = rms_radius(surface.vertices)
    between = float(np.sqrt(surface.area / len(points)))
    scale = Scale(radius, between, spacing)
    prior = MovedPrior.of(surface, points, spacing, settings.splines.clip * radius)
    weights = clusters_believed(points, believed.weights, prior, between, settings)
    if (weights > 0.5).sum() < settings.least_points:
        return None
    wall = _oriented(points, noise, weights, prior, settings)
    alone = wall.heights + prior.at(wall.feet)
    amplitude, residual = _best_amplitude(wall, prior, scale, settings)
    gain = _gain(alone, residual, noise, weights)
    if gain < settings.evidence:
        return None
    sigma = float(np.median(noise))
    for _ in range(settings.rounds):
        field = fitted(wall.of(wall.weights > 0.5), prior, amplitude, scale, settings)
        fit = distance_over(wall, prior, field)
        factor, apart = _noise(fit, residual, noise, weights)
        sigma = factor * float(np.median(noise))
        weights, contact = update_contact(residual, (factor * noise) ** 2 + apart, believed.odds, contact)
        if (weights > 0.5).sum() < settings.least_points:
            return None
        wall = _oriented(points, factor * noise, weights, prior, settings, wall.normals)
        residual = left_out_distances(wall, prior, amplitude, scale, settings)
    touching = wall.of(wall.weights > 0.5)
    field = fitted(touching, prior, amplitude, scale, settings)
    for _ in range(settings.turns):
        touching = turned_along(touching, prior, field, settings.normals)
        touching = touching.nearer(phi_at(touching.feet, prior, field))
        field = fitted(touching, prior, amplitude, scale, settings)
    lengths = scale.lengths(float(np.median(touching.noise)), settings.splines)
    return Reconstruction(prior, field, touching, sigma, weights, amplitude, gain, radius, between, lengths)


def _oriented(
    points: Array,
    noise: Array,
    weights: Array,
    prior: MovedPrior,
    settings: ReconstructionSettings,
    before: Array | None = None,
) -> Oriented:
    """The points with outward normals, found among the believed ones; `before`: what they (n, 3) were."""
    radius = rms_radius(prior.surface.vertices)
    chosen = settings.normals
    believed = weights > 0.5
    around = max(chosen.radius * radius, chosen.radius_noise * float(np.median(noise)))
    normals, middle = planes(points, believed, around, chosen)
    gap = nearest(points[believed], points[believed], NEAREST + 1)[0][:, -1]
    areas = np.pi * gap**2 / NEAREST
    areas = np.minimum(areas, settings.normals.largest_area * np.median(areas))
    earlier = None if before is None else before[believed]
    normals[believed] = turned_outward(points[believed], normals[believed], areas, prior, chosen, earlier)
    like = nearest(points[believed], points[~believed], 1)[1][:, 0]
    sides = (normals[~believed] * normals[believed][like]).sum(axis=1)
    normals[~believed] *= np.where(sides < 0.0, -1.0, 1.0)[:, None]
    heights = ((points - middle) * normals).sum(axis=1)
    return Oriented(points - heights[:, None] * normals, heights, normals, noise, weights)


def _best_amplitude(
    wall: Oriented, prior: MovedPrior, scale: Scale, settings: ReconstructionSettings
) -> tuple[float, Array]:
    """The deviation of the field that predicts points best, and the residuals (n,) with it."""
    best = None
    off = off_prior(wall, prior, settings.splines)
    for amplitude in scale.radius * np.asarray(settings.amplitudes):
        residual = left_out_distances(wall, prior, float(amplitude), scale, settings)
        error = _spread(residual, wall.noise, np.where(off, 0.0, wall.weights))
        if best is None or error < best[0]:
            best = error, float(amplitude), residual
    assert best is not None
    return best[1], best[2]


def _spread(residual: Array, noise: Array, weights: Array) -> float:
    """Root mean square of residuals (n,) over their noise (n,), weighted."""
    return float(np.sqrt((weights * (residual / noise) ** 2).sum() / weights.sum()))


def _gain(alone: Array, residual: Array, noise: Array, weights: Array) -> float:
    """Log likelihood of points predicted, over that by the moved prior, each with the noise that is best for
    it.
    """
    ratio = _spread(alone, noise, weights) / _spread(residual, noise, weights)
    return float(weights.sum() * np.log(ratio))


def _noise(fit: Array, residual: Array, noise: Array, weights: Array) -> tuple[float, float]:
    """Factor on the noise (n,), and the variance of the wall that others predict.

    A linear fit leaves (1 - h) of a residual to the wall without the point, whose variance is 1 / (1 - h) of
    the noise: their product has the noise as its mean.
    """
    believed = weights > 0.5
    squares = (weights * fit * residual / noise**2)[believed].sum() / weights[believed].sum()
    factor = float(np.sqrt(max(squares, ROUNDING)))
    whole = (weights * residual**2)[believed].sum() / weights[believed].sum()
    return factor, max(float(whole - np.mean((factor * noise[believed]) ** 2)), 0.0)
