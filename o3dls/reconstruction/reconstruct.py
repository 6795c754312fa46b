"""phi as the moved prior's signed distance plus a field that the points ask for.

phi = psi.T + g, with g smooth and small before points are seen: near points phi follows them, as a
reconstruction of the points alone would; where there are none it is the moved prior. Which points belong to
the wall is asked of the points themselves (`contact`), on which side of them is inside of all of them
together (`normals`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import ROUNDING, Array
from ..geometry.differential import normals_and_curvature
from ..geometry.similarity import rms_radius
from ..geometry.surface import Surface, interpolated
from ..noise.contact import Contact, inside_point_weights, update_contact
from ..noise.curved_wall import curved_wall_bias
from ..noise.robust import MAD_TO_SD
from ..parallel import one_blas_thread
from .field.amplitude import amplitudes
from .field.equations import NEAREST, OffSurface, Oriented
from .field.moved_prior import MovedPrior
from .field.reconstruction import Reconstruction
from .field.spline_fit import Scale, bias_along, distance_over, fitted, phi_at, turned_along
from .field.splines import SplineField
from .neighbours import nearest
from .points.believed import Believed, Inside
from .points.left_out import gain_off_prior, left_out_distances
from .points.orientation import planes, turned_outward
from .points.wall_likelihood import gain_of_wall
from .settings import ReconstructionSettings
from .shape.surplus import surplus


@dataclass(frozen=True, eq=False)
class _Given:
    """This is what stays fixed in a reconstruction: points as the motion left them, the moved prior, lengths,
    settings.
    """

    believed: Believed
    prior: MovedPrior
    scale: Scale
    settings: ReconstructionSettings

    def enough(self, weights: Array) -> bool:
        """Return whether as many points are believed, by probabilities (n,), as tell a wall by themselves."""
        return bool((weights > 0.5).sum() >= self.settings.least_points)


@one_blas_thread()
def reconstruct(
    surface: Surface, believed: Believed, spacing: float, settings: ReconstructionSettings
) -> Reconstruction | None:
    """Reconstruct the wall from points on top of a moved prior, a closed surface; None where that predicts
    points no better than the moved prior does.

    spacing: of the lattice of phi.
    """
    points = believed.points
    radius = rms_radius(surface.vertices)
    scale = Scale(radius, float(np.sqrt(surface.area / len(points))), spacing)
    prior = MovedPrior.of(surface, points, spacing, settings.splines.clip * radius)
    if not (prior.box < 0.0).any():  # thinner than the lattice: there is no inside to begin with
        return None
    if believed.template:  # its walls look elsewhere and bend otherwise: planes through points are believed
        settings = replace(settings, normals=settings.normals.of_template())
    else:
        believed = _take_off_bias(believed, prior, settings)
    given = _Given(believed, prior, scale, settings)
    if not given.enough(believed.weights):
        return None
    wall = oriented_by_others(believed.points, believed.noise, believed.weights, prior, settings)
    if believed.stretch is not None:  # points of one stretch of the order share errors
        wall = replace(wall, stretch=believed.stretch)
    if len(np.unique(wall.stretch)) < settings.folds:  # none can be predicted by others
        return None
    chosen = amplitudes(wall, prior, scale, settings)
    wall = replace(wall, amplitude=chosen.at)
    asked = _weigh_evidence(given, wall, chosen.gain)
    if asked is None:
        return None
    gain, residual = asked
    believed_at_last = _who_touches(given, wall, chosen.noise_factor * believed.noise, residual)
    if believed_at_last is None:
        return None
    wall, sigma, contact = believed_at_last
    # distances alone take what points share, or creases that noise rounds, for a wall of the patient
    if not believed.template and gain_of_wall(wall, points, prior, scale, settings) < 0.0:
        return None
    touching = wall.of(wall.weights > 0.5)
    lengths = scale.wall_lengths(touching.noise, settings.splines)
    touching, field = _follow_points(given, touching, lengths, contact)
    inside, between = believed.inside.points, scale.between
    known = radius, between, lengths, inside, contact, believed.template
    return Reconstruction(prior, field, touching, sigma, wall.weights, gain, *known)


def _take_off_bias(believed: Believed, prior: MovedPrior, settings: ReconstructionSettings) -> Believed:
    """Return the points without the mean that noise along a curved wall gives their distances from it: it
    would look like a wall that lies farther out.
    """
    surface, curved = prior.surface, settings.curved
    limit = curved.most_curvature / rms_radius(surface.vertices)
    normals, bends = normals_and_curvature(surface.vertices, surface.faces, limit)
    _, face, _, weights = prior.tree.query(believed.points)
    corners = surface.faces[face]
    outward = interpolated(normals, corners, weights)
    bias = curved_wall_bias(believed.noise, interpolated(bends, corners, weights), curved)
    return replace(believed, points=believed.points - bias[:, None] * outward)


def _weigh_evidence(given: _Given, wall: Oriented, field_gain: float) -> tuple[float, Array] | None:
    """Weigh by how many nats points are predicted better than by the moved prior alone, and find their signed
    distances (n,) from the wall that others make; None where that is too little evidence for a
    reconstruction.

    field_gain: nats of the points near the moved prior.
    """
    prior, scale, settings, contact = given.prior, given.scale, given.settings, given.believed.contact
    gain, enough, absent = field_gain, field_gain >= settings.field_evidence, False
    if not enough:
        touching = wall.of(wall.weights > 0.5)
        lengths = scale.radius, scale.between
        if given.believed.template:
            lacking = surplus(prior.box, touching, prior, *lengths, settings.surplus)[1]
            gain += lacking
            absent = lacking > 0.0
        # most maps end here: even if points lay exactly on the new wall, they would not be evidence enough
        exact = np.zeros(len(wall.feet))
        if not absent and gain + gain_off_prior(wall, prior, exact, contact, settings) < settings.evidence:
            return None
    residual = left_out_distances(wall, prior, scale, settings)
    gain += gain_off_prior(wall, prior, residual, contact, settings)
    asked = absent or gain >= settings.evidence or (enough and gain > 0.0)
    return (gain, residual) if asked else None


def _who_touches(
    given: _Given, wall: Oriented, noise: Array, residual: Array
) -> tuple[Oriented, float, Contact] | None:
    """Return the wall of the points that touch, by predictions of each from the others, with their noise and
    the mixture; None where too few are left.
    """
    prior, scale, settings, contact = given.prior, given.scale, given.settings, given.believed.contact
    for again in range(settings.rounds_of_template if given.believed.template else 1):
        if again:
            residual = left_out_distances(wall, prior, scale, settings)
        touching = wall.of(wall.weights > 0.5)
        field = fitted(touching, prior, scale, settings, scale.lengths(touching.noise, settings.splines))
        factor, apart = _estimate_noise(distance_over(wall, prior, field), residual, noise, wall.weights)
        sd = factor * noise
        weights, contact = update_contact(residual, sd**2 + apart, given.believed.odds, contact)
        if not given.enough(weights):
            return None
        wall = oriented_by_others(given.believed.points, sd, weights, prior, settings, wall)
    return wall, float(np.median(wall.noise)), contact


def _follow_points(
    given: _Given, touching: Oriented, lengths: list[float], contact: Contact
) -> tuple[Oriented, SplineField]:
    """Fit the field on lattices of some widths to the points, with the normals of the wall that they make,
    until no point known to be inside is left outside; return both.
    """
    prior, scale, settings = given.prior, given.scale, given.settings
    field = fitted(touching, prior, scale, settings, lengths)
    touching = turned_along(touching, prior, field, settings.normals)
    if given.believed.template:  # a patient's own prior has told the bends before
        bias = bias_along(touching, prior, field, settings.curved)
        touching = replace(touching, heights=touching.heights - bias)
    touching = touching.nearer(phi_at(touching.feet, prior, field))
    field = fitted(touching, prior, scale, settings, lengths)
    for _ in range(settings.rounds_inside):
        known = _left_outside(given.believed.inside, touching, prior, field, contact)
        if not len(known.at):
            break
        field = fitted(touching, prior, scale, settings, lengths, known)
    return touching, field


def _left_outside(
    inside: Inside, wall: Oriented, prior: MovedPrior, field: SplineField, contact: Contact
) -> OffSurface:
    """Find the points known to be inside that the wall of a field leaves outside; it must go through them at
    least.
    """
    phi = phi_at(inside.points, prior, field)
    outside = phi > 0.0
    radius = rms_radius(prior.surface.vertices)
    weights = inside_point_weights(inside.points, outside, radius, contact.settings)
    rows = np.flatnonzero(outside & (weights > 0.0))
    like = nearest(wall.feet, inside.points[rows], 1)[1][:, 0]
    at, noise = inside.points[rows], inside.noise[rows]
    amplitude = np.maximum(wall.amplitude[like], phi[rows])
    return OffSurface(at, np.zeros(len(rows)), noise, weights[rows], amplitude)


def oriented_by_others(
    points: Array,
    noise: Array,
    weights: Array,
    prior: MovedPrior,
    settings: ReconstructionSettings,
    before: Oriented | None = None,
) -> Oriented:
    """Return the points with outward normals, found among the believed ones; `before`: what they were."""
    radius = rms_radius(prior.surface.vertices)
    chosen = settings.normals
    believed = weights > 0.5
    around = max(chosen.radius * radius, chosen.radius_noise * float(np.median(noise)))
    found = planes(points, believed, around, chosen)
    normals = found.normals
    gap = nearest(points[believed], points[believed], NEAREST + 1)[0][:, -1]
    areas = np.pi * gap**2 / NEAREST
    areas = np.minimum(areas, settings.normals.largest_area * np.median(areas))
    earlier = None if before is None else before.normals[believed]
    normals[believed] = turned_outward(points[believed], normals[believed], areas, prior, chosen, earlier)
    like = nearest(points[believed], points[~believed], 1)[1][:, 0]
    sides = (normals[~believed] * normals[believed][like]).sum(axis=1)
    normals[~believed] *= np.where(sides < 0.0, -1.0, 1.0)[:, None]
    heights = ((points - found.middles) * normals).sum(axis=1)
    amplitude = np.zeros(len(points)) if before is None else before.amplitude
    stretch = np.arange(len(points)) if before is None else before.stretch
    feet = points - heights[:, None] * normals
    return Oriented(feet, heights, normals, found.tilt, found.flat, noise, weights, amplitude, stretch)


def _estimate_noise(fit: Array, residual: Array, noise: Array, weights: Array) -> tuple[float, float]:
    """Estimate the factor on the noise (n,) and the variance of the wall that others predict.

    A linear fit leaves (1 - h) of a residual to the wall without the point, whose variance is 1 / (1 - h) of
    the noise: their product is that of the noise. Its median counts, since detail finer than the distance
    between points makes a few products large.
    """
    believed = weights > 0.5
    middle = MAD_TO_SD**2 * float(np.median((fit * residual / noise**2)[believed]))
    factor = float(np.sqrt(max(middle, ROUNDING)))
    whole = (weights * residual**2)[believed].sum() / weights[believed].sum()
    return factor, max(float(whole - np.mean((factor * noise[believed]) ** 2)), 0.0)
