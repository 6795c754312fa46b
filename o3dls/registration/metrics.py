"""What an ICP step minimises over a small motion of the surface, pairs held: sum_i w_i g_i' Omega_i g_i with
g_i = point - foot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Array
from .match import Pairs


@dataclass(frozen=True, eq=False)
class Factors:
    """Factors are pairs with the information matrices Omega (n, d, d) of their gaps; `lever` says where a
    rotation acts: 1 at the point, because Omega turns with the surface, 0.5 half way from the foot where both
    sides share the rotation. `closed_form`: the minimum over all motions is known, so that one step reaches
    it.
    """

    pairs: Pairs
    information: Array
    lever: float = 1.0
    closed_form: bool = False

    @cached_property
    def residuals(self) -> Array:
        """Sizes (n,) of the gaps as the metric sees them."""
        gaps = self.pairs.gaps
        return np.asarray(
            np.sqrt((np.matmul(self.information, gaps[:, :, None])[:, :, 0] * gaps).sum(axis=1).clip(0.0))
        )


Metric = Callable[[Pairs], Factors]


def point_to_point(pairs: Pairs) -> Factors:
    """Return the distance between point and foot (Besl and McKay 1992)."""
    n, d = pairs.points.shape
    return Factors(pairs, np.broadcast_to(np.eye(d), (n, d, d)), closed_form=True)


def point_to_plane(pairs: Pairs) -> Factors:
    """Return the distance of the point from the tangent plane at its foot (Chen and Medioni 1992)."""
    return Factors(pairs, _outer_products(pairs.normals))


def symmetric(point_normals: Array) -> Metric:
    """Return the distance along the mean of surface normal and point normal (n, d), the rotation shared by
    both sides (Rusinkiewicz 2019).
    """

    def factors(pairs: Pairs) -> Factors:
        along = (pairs.normals * point_normals).sum(axis=1, keepdims=True) >= 0.0
        return Factors(
            pairs,
            _outer_products(0.5 * (pairs.normals + np.where(along, point_normals, -point_normals))),
            lever=0.5,
        )

    return factors


def generalized(point_normals: Array, thickness: float = 0.05) -> Metric:
    """Weigh gaps by the Mahalanobis distance between two patches that are flat but for a relative variance
    `thickness` (Segal 2009).
    """

    def flat(normals: Array) -> Array:
        return np.asarray(np.eye(normals.shape[1]) - (1.0 - thickness) * _outer_products(normals))

    return lambda pairs: Factors(pairs, np.asarray(np.linalg.inv(flat(pairs.normals) + flat(point_normals))))


def _outer_products(vectors: Array) -> Array:
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])
