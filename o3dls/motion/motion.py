"""The motion T of the prior as a function of points, with its posterior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array, Ints
from ..geometry.closest_point import ClosestPoint
from ..geometry.differential import unit_mean
from ..geometry.similarity import apply
from .field.covariance import Places
from .field.gaussian_process import FieldPosterior


@dataclass(frozen=True, eq=False)
class FittedMotion:
    """A fitted motion takes the prior frame to the map frame, as a function of points with its posterior
    deviation (interface.Motion).

    probability is that the points show a motion at all: so far the field is followed, and for the rest the
    similarity `pose_alone` (d+1, d+1), from the reference pose to where it would be without a motion, so that
    points which cannot tell a motion from noise leave the prior its shape. inflation calibrates the deviation
    (docs/method_deviation.md), and doubt is that of errors which the points may share unseen.
    """

    vertices: Array  # of the prior, in its own frame
    faces: Ints
    T_map_prior: Array  # the reference pose,
    # and the vertices in it, from which the field displaces: faired where the points show the prior to be
    # rough
    rest: Places
    field: FieldPosterior
    probability: float
    pose_alone: Array
    inflation: float
    tree: ClosestPoint  # of the faces, wherever the vertices are
    doubt: float = 0.0

    def __call__(self, points: Array) -> Array:
        places = self._find_reference(points)
        return self.mean(places.at, self.field.mean(places))

    def mean(self, at: Array, field: Array) -> Array:
        """Return where places (n, d) of the reference pose went that the field would displace by (n, d)."""
        return at + self.probability * field + (1.0 - self.probability) * self._shift_alone(at)

    def sd(self, points: Array, normals: Array) -> Array:
        """Return the posterior standard deviation (n,) along unit `normals` (map frame) of where points (n,
        d) of the prior frame went.
        """
        return self.sd_in_reference(self._find_reference(points), normals)

    def joint(self, points: Array, normals: Array) -> Array:
        """Return the posterior covariance (n, n) along unit `normals` (map frame) of where points (n, d) of
        the prior frame went, given that they moved: its diagonal is `sd` squared where the motion is certain
        and there is no doubt.
        """
        return self.inflation**2 * self.field.covariance(self._find_reference(points).observed(normals))

    def sd_in_reference(self, places: Places, normals: Array) -> Array:
        """Return `sd` for places that are known in the reference pose."""
        var = self.field.variance(places.observed(normals))
        # the points may miss a motion that is there: the deviation is that of the motion from where the
        # surface is left
        held_back = (
            0.0
            if self.probability == 1.0
            else (self.unfollowed(places.at, self.field.mean(places)) * normals).sum(axis=1)
        )
        return np.asarray(np.hypot(self.inflation * np.sqrt(var + held_back**2), self.doubt))

    def unfollowed(self, at: Array, field: Array) -> Array:
        """Return the part (n, d) of the motion at places (n, d) of the reference pose that is not followed,
        where the field would displace them by (n, d).
        """
        return (1.0 - self.probability) * (field - self._shift_alone(at))

    def _shift_alone(self, at: Array) -> Array:
        return apply(self.pose_alone, at) - at

    @cached_property
    def _moved_tree(self) -> ClosestPoint:
        return self.tree.at(self.vertices)

    def _find_reference(self, points: Array) -> Places:
        """Find where points lie in the reference pose, shifted as the surface nearest to them was, with that
        surface's normals.
        """
        if points is self.vertices:
            return self.rest
        _, face, _, bary = self._moved_tree.query(points)
        corner = self.faces[face]
        shift = (self.rest.at - apply(self.T_map_prior, self.vertices))[corner]
        at = apply(self.T_map_prior, points) + np.einsum("nc,ncd->nd", bary, shift)
        return Places(at, unit_mean(self.rest.normals, corner, bary))
