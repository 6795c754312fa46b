"""Fitting the field to points with normals: lengths, deviation, and what follows for the points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from ...noise.curved_wall import curved_wall_bias
from ...noise.settings import CurvedWallSettings
from ..settings import NormalSettings, ReconstructionSettings, SplineSettings
from .equations import OffSurface, Oriented, field_through, off_prior, off_surface
from .moved_prior import MovedPrior
from .splines import SplineField


@dataclass(frozen=True)
class Scale:
    """The scale gives the lengths of a reconstruction: rms radius of the prior, distance between points,
    spacing of the lattice of phi.
    """

    radius: float
    between: float
    spacing: float

    def lengths(self, noise: Array, settings: SplineSettings) -> list[float]:
        """Return the widths of the lattices of splines by which points with noise (n,) predict each other."""
        return self._halve_widths(settings.finest_between, noise, settings)

    def wall_lengths(self, noise: Array, settings: SplineSettings) -> list[float]:
        """Return the widths of those that the wall follows: with finer ones, that hardly reach from a point
        to the next, long ones do not carry what points ask for into wall that has none.
        """
        return self._halve_widths(settings.wall_finest_between, noise, settings)

    def _halve_widths(self, finest_between: float, noise: Array, settings: SplineSettings) -> list[float]:
        """Return widths from coarse to fine, each half as wide as the one before."""
        finest = max(
            finest_between * self.between,
            settings.finest_noise * float(np.median(noise)),
            settings.finest_spacing * self.spacing,
        )
        coarsest = settings.coarsest * self.radius
        halvings = max(int(np.log2(coarsest / finest)), 0)
        return [coarsest / 2**k for k in range(halvings + 1)]


def phi_at(places: Array, prior: MovedPrior, field: SplineField) -> Array:
    """Return phi (n,) at places (n, 3)."""
    return prior.at(places) + field.at(places)


def distance_over(wall: Oriented, prior: MovedPrior, field: SplineField) -> Array:
    """Return the signed distance (n,) of points from the wall of a field."""
    return wall.heights + phi_at(wall.feet, prior, field)


def turned_along(wall: Oriented, prior: MovedPrior, field: SplineField, settings: NormalSettings) -> Oriented:
    """Return the points with the normals of the wall of a field, where it has one near their feet."""
    ends = [
        (wall.feet + along, wall.feet - along) for along in settings.slope_step * prior.spacing * np.eye(3)
    ]
    rises = [phi_at(end, prior, field) - phi_at(start, prior, field) for end, start in ends]
    slope = np.column_stack(rises) / (2.0 * settings.slope_step * prior.spacing)
    length = np.linalg.norm(slope, axis=1)
    steep = length > settings.least_slope
    normals = wall.normals.copy()
    normals[steep] = slope[steep] / length[steep, None]
    points = wall.points
    heights = ((points - wall.feet) * normals).sum(axis=1)
    feet = points - heights[:, None] * normals
    return replace(wall, feet=feet, heights=heights, normals=normals, tilt=np.where(steep, 0.0, wall.tilt))


def bias_along(wall: Oriented, prior: MovedPrior, field: SplineField, settings: CurvedWallSettings) -> Array:
    """Return how far (n,) noise carries points outside the wall of a field in the mean, by how that bends.

    The bends are second differences of phi over sqrt(3) deviations of the noise to either side: the nodes of
    a three-point Gauss-Hermite average over it.
    """
    on_wall = wall.feet - phi_at(wall.feet, prior, field)[:, None] * wall.normals
    flat = np.eye(3)[np.abs(wall.normals).argmin(axis=1)]
    first = np.cross(wall.normals, flat)
    first /= np.linalg.norm(first, axis=1)[:, None]
    step = np.sqrt(3.0) * wall.noise[:, None]
    rise = -4.0 * phi_at(on_wall, prior, field)
    for along in (first, np.cross(wall.normals, first)):
        rise += phi_at(on_wall + step * along, prior, field) + phi_at(on_wall - step * along, prior, field)
    return curved_wall_bias(wall.noise, rise / step[:, 0] ** 2, settings)


def fitted(
    wall: Oriented,
    prior: MovedPrior,
    scale: Scale,
    settings: ReconstructionSettings,
    lengths: list[float],
    known: OffSurface | None = None,
) -> SplineField:
    """Return the field on lattices of some widths that points ask for, and `known` values of phi
    elsewhere.
    """
    chosen = settings.splines
    off = off_prior(wall, prior, chosen)
    constraints = off_surface(wall, off, prior, scale.radius, chosen)
    constraints = constraints if known is None else constraints.joined(known)
    return field_through(wall, constraints, prior, lengths, chosen)
