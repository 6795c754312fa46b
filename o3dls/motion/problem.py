"""What stays fixed while a motion is fitted: the posed prior, its nodes, the data, the covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ..arrays import Array, Ints
from ..geometry.closest_point import ClosestPoint
from ..geometry.differential import unit_mean, vertex_normals
from ..geometry.fairing import fair, roughness
from ..geometry.similarity import apply, principal_frame, rms_radius
from ..noise.contact import Contact, update_contact
from ..noise.mixture import fit_mixture
from ..noise.robust import robust_sd
from .correspondence import likely_feet
from .field.covariance import Covariance, Places, interpolation
from .field.observations import LEAST_WEIGHT, Data, Feet
from .settings import MotionSettings

# where on a surface points (n, d) of noise (n,) may have come from, by the surface's places at rest
Correspondence = Callable[[ClosestPoint, Array, Array, Places], Feet]
# which points touch, by residual, variance and odds of floating (n,): probabilities (n,) and the mixture
Contacts = Callable[[Array, Array, Array, Contact], tuple[Array, Contact]]
Smoothed = tuple[float, Array]  # a length and the vertices (n, d) of the posed prior smoothed over it
LEAST_RESIDUAL = 1e-4  # rms radii: residuals of points exactly on the prior still need a scale


@dataclass(frozen=True, eq=False)
class MotionProblem:
    """A problem has the prior (vertices (n, d), faces (m, d), its own frame) in a pose, and what is fitted to
    it.

    rest: the vertices in the reference pose, smoothed over `smoothing_length` (0: not at all); rough (n, d):
    what roughness they have there; marks (k, d): landmarks of the prior in the reference pose; size: its rms
    radius; nodes: vertices from which the field is interpolated to all by the matrix `from_nodes`.
    """

    vertices: Array
    faces: Ints
    pose: Array
    rest: Places
    smoothing_length: float
    rough: Array
    data: Data
    marks: Array
    covariance: Covariance
    settings: MotionSettings
    size: float
    tree: ClosestPoint
    nodes: Ints
    from_nodes: sparse.csr_matrix
    correspondence: Correspondence
    contacts: Contacts = update_contact

    @cached_property
    def frame(self) -> Array:
        """The prior's own axes (d+1, d+1), for what must not depend on those of the map."""
        return principal_frame(self.rest.at)

    @cached_property
    def residual_sd(self) -> float:
        """Standard deviation of the points' distances from the posed surface, by their median: outliers have
        no influence.
        """
        distances = self.tree.at(self.rest.at).distance(self.data.points[~self.data.inside])
        return max(robust_sd(distances), LEAST_RESIDUAL * self.size)

    @cached_property
    def company(self) -> Ints:
        """The nearest others (n, k) of each point that is not known to be inside, in rows of these."""
        points = self.data.points[~self.data.inside]
        count = min(self.settings.contact.company, len(points) - 1)
        if count < 1:
            return np.zeros((len(points), 0), dtype=np.int64)
        return np.asarray(cKDTree(points).query(points, [*range(2, count + 2)])[1])

    @cached_property
    def first_weights(self) -> Array:
        """Probability (n,) that points touch, by their distance from the posed surface: many that float
        together would pull the wall out if all were trusted.
        """
        weights = self.data.trusted
        wall = ~self.data.inside
        points = self.data.points[wall]
        _, face, foot, bary = self.tree.at(self.rest.at).query(points)
        outward = (points - foot) * unit_mean(self.rest.normals, self.faces[face], bary)
        touching = np.maximum(
            fit_mixture(outward.sum(axis=1), self.size, self.settings.contact).weights, LEAST_WEIGHT
        )
        weights[wall] = touching / (touching + (1.0 - touching) * self.data.outlier_odds[wall])
        return weights

    @cached_property
    def at_nodes(self) -> Places:
        at = self.rest.at[self.nodes]
        return Places(at, self.rest.normals[self.nodes], self.covariance.features(at))


def motion_problem(
    vertices: Array,
    faces: Ints,
    pose: Array,
    data: Data,
    settings: MotionSettings,
    smoothed: Smoothed | None = None,
) -> MotionProblem:
    """Return the problem of a prior in a pose (d+1, d+1), smoothed or as it is."""
    posed = apply(pose, vertices)
    size = rms_radius(posed)
    marks = apply(pose, data.marks_prior)
    covariance = _scale_covariance(posed, marks, settings)
    length, at = smoothed or (0.0, posed)
    shortest = min(covariance.lengths)
    nodes = space_points(at, settings.covariance.node_spacing * shortest)
    rough = roughness(at, faces, size * settings.covariance.normals_length)
    return MotionProblem(
        vertices=vertices,
        faces=faces,
        pose=pose,
        rest=Places(at, vertex_normals(fair(at, rough, vertex_normals(at, faces)), faces)),
        smoothing_length=length,
        rough=rough,
        data=data,
        marks=marks,
        covariance=covariance,
        settings=settings,
        size=size,
        tree=ClosestPoint(at, faces),
        nodes=nodes,
        from_nodes=interpolation(at[nodes], at, shortest, settings.covariance.node_neighbours),
        correspondence=partial(
            likely_feet,
            cutoff=settings.iteration.foot_cutoff,
            resolution=settings.iteration.foot_resolution,
        ),
    )


def _scale_covariance(posed: Array, marks: Array, settings: MotionSettings) -> Covariance:
    """Return the covariance with its lengths in units of the map."""
    chosen = settings.covariance
    size = rms_radius(posed)
    return Covariance(
        centre=posed.mean(axis=0),
        vector=tuple(size * x for x in chosen.vector_lengths),
        normal=tuple(size * x for x in chosen.normal_lengths),
        radius=size,
        anchors=marks,
        anchor_length=size * min(chosen.vector_lengths + chosen.normal_lengths),
        translation=chosen.translation_sd * size,
        rotation=chosen.rotation_sd,
        scale=chosen.scale_sd,
    )


def space_points(points: Array, spacing: float) -> Ints:
    """Return the indices of points that stand about `spacing` apart: the one nearest to the middle of each
    occupied cell.
    """
    cells = np.floor((points - points.min(axis=0)) / spacing)
    middle = ((points - points.min(axis=0)) / spacing - cells - 0.5) ** 2
    order = np.lexsort((middle.sum(axis=1), *cells.T))
    first = np.r_[True, (np.diff(cells[order], axis=0) != 0).any(axis=1)]
    return np.asarray(np.sort(order[first]))
