"""How much likelier a wall that points show is than the moved prior's: by other points, and their density.

Distances from the wall that neighbours make are small where neighbours share an error, and where noise is as
long as the wall bends: points near a crease agree on a rounder wall. The density of other points, which come
from a wall evenly and with noise, tells both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from ...arrays import Array
from ...geometry.differential import vertex_normals
from ...geometry.surface import Surface
from ..field.equations import Oriented
from ..field.moved_prior import MovedPrior
from ..field.spline_fit import Scale, fitted, phi_at
from ..field.splines import SplineField
from ..neighbours import SEED
from ..settings import ReconstructionSettings
from ..shape_settings import HandleSettings
from .point_density import log_density


def gain_of_wall(
    wall: Oriented, measured: Array, prior: MovedPrior, scale: Scale, settings: ReconstructionSettings
) -> float:
    """Return by how many nats half of the points are likelier under the wall that the other half makes than
    under the moved prior's, each with the noise that is best for it.

    measured (n, 3): the points where noise left them, as their density has it.
    """
    believed = wall.weights > 0.5
    apart, stretch = np.unique(wall.stretch, return_inverse=True)
    half = (np.random.default_rng(SEED).permutation(len(apart)) % 2)[stretch] == 0
    known, tested = wall.of(believed & half), np.flatnonzero(believed & ~half)
    if not len(known.feet) or not len(tested):
        return 0.0
    tested = tested[:: max(-(-len(tested) // settings.amplitude.most_points), 1)]
    fewer = replace(scale, between=scale.between * np.sqrt(len(half) / len(known.feet)))
    lengths = fewer.wall_lengths(known.noise, settings.splines)
    field = fitted(known, prior, fewer, settings, lengths)
    before = _with_fine_faces(prior.surface, float(np.median(wall.noise)), settings.most_faces)
    # the centres of larger faces do not stand for them
    noise = np.maximum(wall.noise[tested], np.sqrt(before.area / len(before.faces)))
    after = replace(before, vertices=_vertices_on_wall(before, prior, field, settings.newton_steps))
    by_points, by_prior = (
        max(
            _log_likelihood(measured[tested], factor * noise, surface, settings.handles)
            for factor in settings.amplitude.noise_factors
        )
        for surface in (after, before)
    )
    return by_points - by_prior


def _with_fine_faces(surface: Surface, noise: float, most: int) -> Surface:
    """Return the surface with faces that are small against the noise: their centres stand for them."""
    from trimesh.remesh import subdivide  # imported late: few runs come here, and all of trimesh with it

    vertices, faces = surface.vertices, surface.faces
    while len(faces) < min(surface.area / noise**2, most):
        vertices, faces = subdivide(vertices, faces)
    return Surface(np.asarray(vertices), np.asarray(faces))


def _vertices_on_wall(surface: Surface, prior: MovedPrior, field: SplineField, steps: int) -> Array:
    """Return the vertices (n, 3) of the moved prior, moved along their normals to the wall of a field."""
    along = vertex_normals(surface.vertices, surface.faces)
    rounded = prior.at(surface.vertices)  # by the lattice
    places = surface.vertices
    for _ in range(steps):
        off = np.clip(phi_at(places, prior, field) - rounded, -prior.clip, prior.clip)
        places = places - off[:, None] * along
    return places


def _log_likelihood(points: Array, noise: Array, wall: Surface, settings: HandleSettings) -> float:
    """Return the log density of points (k, 3) with noise (k,) that come from the wall near them, evenly."""
    near = KDTree(points)
    places, reach = wall.vertices[wall.faces].mean(axis=1), settings.reach * float(np.median(noise))
    counts = near.query(places, distance_upper_bound=reach)[0] < reach
    return log_density(near, noise, wall, wall.face_areas[counts].sum(), settings)
