"""What an ICP step minimises over a small motion of the surface, pairs held: sum_i w_i g_i' Omega_i g_i with g_i = point - foot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..geometry import Array
from .match import Pairs


@dataclass(frozen=True, eq=False)
class Metric:
    """Information matrices Omega (n, d, d) of the gaps; `lever` says where a rotation acts: 0 at the foot, 0.5 half way to the point.

    `closed_form` is true where the minimum over all motions is known, so that one step reaches it.
    """

    information: Callable[[Pairs], Array]
    lever: float = 0.0
    closed_form: bool = False

    def residuals(self, pairs: Pairs) -> Array:
        """Sizes (n,) of the gaps as the metric sees them."""
        return np.asarray(np.sqrt(np.einsum("ni,nij,nj->n", pairs.gaps, self.information(pairs), pairs.gaps)))


def point_to_point() -> Metric:
    """Distance between point and foot (Besl and McKay 1992)."""

    def information(pairs: Pairs) -> Array:
        n, d = pairs.points.shape
        return np.broadcast_to(np.eye(d), (n, d, d))

    return Metric(information, closed_form=True)


def point_to_plane() -> Metric:
    """Distance of the point from the tangent plane at its foot (Chen and Medioni 1992)."""
    return Metric(lambda pairs: _outer(pairs.normals))


def symmetric(point_normals: Array) -> Metric:
    """Distance along the mean of surface normal and point normal, the rotation shared by both sides (Rusinkiewicz 2019)."""

    def information(pairs: Pairs) -> Array:
        along = (pairs.normals * point_normals).sum(axis=1, keepdims=True) >= 0.0
        return _outer(0.5 * (pairs.normals + np.where(along, point_normals, -point_normals)))

    return Metric(information, lever=0.5)


def generalized(point_normals: Array, thickness: float = 1e-3) -> Metric:
    """Mahalanobis distance between two patches that are flat but for a relative variance `thickness` (Segal 2009)."""

    def flat(normals: Array) -> Array:
        return np.eye(normals.shape[1]) - (1.0 - thickness) * _outer(normals)

    return Metric(lambda pairs: np.linalg.inv(flat(pairs.normals) + flat(point_normals)))


def _outer(vectors: Array) -> Array:
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])
