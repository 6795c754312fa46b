"""Samples of a surface: the errors of the motion at its vertices, of which the part along the normal is as
the surface states it; and whether there is wall.

Where the wall was reconstructed, what is known along the normal comes from the reconstruction, and in the
wall from the motion. With s the stated deviation along the unit normal n, and C the covariance of the
motion's error e,

    e' = e + (s / sqrt(n' C n) - 1) n n' e:

the error in the wall stays, that along the normal has the deviation s, and both go together as in the motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.special import ndtri

from ...arrays import ROUNDING, TINY, Array, Mask
from ...geometry.surface import Surface
from ...parallel import axes_of, by_rows
from ..field.kernels import NUGGET, matern
from .nodes import NodeSums
from .posterior import WallPosterior


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Samples are surfaces as likely as one another: vertices (n, v, d) in the map frame, and at which of
    them there is wall, exists (n, v).

    surface is the one that they scatter about; all have its faces and fields.
    """

    surface: Surface
    vertices: Array
    exists: Mask

    def __len__(self) -> int:
        return len(self.vertices)

    def __getitem__(self, k: int) -> Surface:
        return self.surface.with_vertices(self.vertices[k])

    def __iter__(self) -> Iterator[Surface]:
        return map(self.surface.with_vertices, self.vertices)


def wall_covariance(surface: Surface, posterior: WallPosterior, sd: Array | None) -> Array:
    """Return the covariance (v, d, d) of the error of each vertex, whose deviation along the normal is sd
    (v,), where that is given and finite.
    """
    found = posterior.at(surface.vertices).covariance()
    normals = surface.vertex_normals
    stretch = np.eye(surface.dimension) + _stretches(found, normals, sd)[:, None, None] * (
        normals[:, :, None] * normals[:, None, :]
    )
    return np.asarray(stretch @ found @ stretch)


def sample_vertices(
    surface: Surface, posterior: WallPosterior, sd: Array | None, count: int, rng: np.random.Generator
) -> Array:
    """Return samples (count, v, d) of the vertices, with the covariances of `wall_covariance`."""
    normals = surface.vertex_normals
    errors = posterior.at(surface.vertices)
    more = _stretches(errors.covariance(), normals, sd)
    found = errors.draw(count, rng)
    by_rows(_stretch_errors, 1, (found,), axes_of(normals), surface.vertices, normals, more)
    return found


@njit(cache=True, nogil=True)
def _stretch_errors(found, axes, vertices, normals, more):  # type: ignore[no-untyped-def]
    """Make errors (k, v, d) longer along the normals by a part (v,), and add the vertices (v, d)."""
    for s in range(len(found)):
        for v in range(len(vertices)):
            along = 0.0
            for a in range(len(axes)):
                along += found[s, v, a] * normals[v, a]
            for a in range(len(axes)):
                found[s, v, a] += more[v] * along * normals[v, a] + vertices[v, a]


def sample_existence(
    surface: Surface,
    likely: Array,
    length: float,
    nodes: Array,
    count: int,
    rng: np.random.Generator,
) -> Mask:
    """Return at which vertices (count, v) there is wall, each with the probability likely (v,); what is
    absent is absent together over a length, as a vein is.
    """
    there = np.tile(likely > 0.0, (count, 1))
    doubtful = (likely > 0.0) & (likely < 1.0)
    if not doubtful.any():
        return there
    correlation = matern(nodes, nodes, length)
    correlation[np.diag_indices_from(correlation)] += NUGGET
    drawn = rng.standard_normal((count, len(nodes))) @ np.linalg.cholesky(correlation).T
    sums = NodeSums.of(nodes, surface.vertices[doubtful], length)
    latent = sums.values(drawn[:, :, None]) / np.sqrt(sums.covariance(correlation, 1)[:, 0])
    there[:, doubtful] = ndtri(likely[doubtful]) >= latent[:, :, 0]
    return there


def _stretches(covariance: Array, normals: Array, sd: Array | None) -> Array:
    """Return by which part (v,) errors along the normals get longer, to have the deviation sd (v,)."""
    if sd is None:
        return np.zeros(len(normals))
    own = np.sqrt(np.maximum(np.einsum("va,vab,vb->v", normals, covariance, normals), 0.0))
    known = np.isfinite(sd) & (own > ROUNDING)
    return np.where(known, sd / np.maximum(own, TINY) - 1.0, 0.0)
