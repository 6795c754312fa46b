"""What changed of the shape of a wall between two motions of one prior: by how much it lies farther out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from ...arrays import Array, Mask
from ...geometry.similarity import apply, fit_similarity
from ...geometry.surface import Surface
from ..measures.intervals import LEVEL
from .regions import stands_out


@dataclass(frozen=True, eq=False)
class ShapeChange:
    """A shape change has the way (n,) of each vertex outward from the first wall to the second, in mm, with
    its interval (n,), and where (n,) that stands out of the errors of all of the wall.
    """

    change: Array
    low: Array
    high: Array
    changed: Mask


def compare_shapes(
    surface: Surface, second: Array, errors: tuple[Array, Array], compared: Mask
) -> ShapeChange:
    """Compare a wall in a map with the same wall in another map, second (n, 3), each with samples of its
    errors (k, n, 3).

    The second wall is laid on the first as a rigid body, in each sample anew: where the heart lies in a map
    is no change of shape. Size is.
    """
    first, normals = surface.vertices, surface.vertex_normals
    area = surface.vertex_areas
    laid = fit_similarity(second, first, area, scale=False)
    apart = apply(laid, second) - first
    change = np.einsum("nd,nd->n", apart, normals)
    found = np.empty((len(errors[0]), len(first)))
    for k, (one, other) in enumerate(zip(*errors, strict=True)):
        moved = first + one
        again = apply(fit_similarity(second + other, moved, area, scale=False), second + other)
        found[k] = np.einsum("nd,nd->n", again - moved, normals) - change
    half = ndtri((1.0 + LEVEL) / 2.0) * found.std(axis=0)
    return ShapeChange(change, change - half, change + half, stands_out(change, found, compared))
