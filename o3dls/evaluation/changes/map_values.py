"""Values of a map at places of the prior, with the joint samples of the errors of these places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array, Ints
from ...geometry.spread import spread
from ...geometry.surface import Surface
from ..interpolation import REACH
from ..projection import project

MOST = 1000  # places of a map that are told apart: several hundred suffice for an atrium
FLOOR = 0.05  # mV: below it a catheter shows its own noise
RATIOS = ("bipolar", "unipolar")  # columns that are compared by their ratio


@dataclass(frozen=True, eq=False)
class MapValues:
    """Map values are values (k,) of points at the faces (k,) of a prior with barycentric weights (k, 3), each
    the mean of count (k,) points; voltages by their logarithm.

    errors (s, n, 3): samples of the error with which the motion places each vertex, in the prior's frame.
    """

    face: Ints
    weights: Array
    values: Array
    count: Array
    errors: Array

    def at(self, prior: Surface, per_vertex: Array) -> Array:
        """Return what is given per vertex (n, ...) at the places (k, ...)."""
        return np.asarray(np.einsum("kc,kc...->k...", self.weights, per_vertex[prior.faces[self.face]]))


def values_on_prior(
    prior: Surface, moved: Surface, points: tuple[Array, Array], errors: Array, *, ratio: bool
) -> MapValues:
    """Bring points, their positions (k, 3) and values (k,) in a map, to the prior by where its motion brought
    it. Points farther than `REACH` from the wall are left out.

    ratio: values are compared by their ratio. Of more than `MOST` points those near each other are averaged.
    """
    xyz, values = points
    wall = project(xyz, moved)
    near = wall.distance <= REACH
    face, weights = wall.face[near], wall.weights[near]
    values = np.log(np.maximum(values[near], FLOOR)) if ratio else values[near]
    if len(values) <= MOST:
        return MapValues(face, weights, values, np.ones(len(values)), errors)
    from scipy.spatial import cKDTree

    foot = wall.foot[near]
    some = spread(foot, MOST)
    nearest = cKDTree(foot[some]).query(foot)[1]
    count = np.bincount(nearest, minlength=len(some)).astype(np.float64)
    mean = np.bincount(nearest, values, len(some)) / count
    return MapValues(face[some], weights[some], mean, count, errors)
