"""The errors of a moved wall in space: the posterior of its motion at nodes of the wall, as one Gaussian.

The motion is a vector process, so its posterior tells the errors along the normal and in the wall alike. Of
the motion T(r) = r + q D(r) + (1 - q) (P r - r) it is known what D is, given that the wall moved:

    e(r) = i (D(r) - E[D(r)]) + i (1 - q) (E[D(r)] - P r + r) xi,     xi ~ N(0, 1)

with the factor i that calibrates deviations (`MotionSettings.inflation`). Along any direction e has the
variance that `FittedMotion.sd` states, and between any two places the covariance of the process.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Array
from ..field.covariance import Observed, Places
from ..field.gaussian_process import FieldPosterior
from .nodes import NodeSums
from .settings import SETTINGS


@dataclass(frozen=True, eq=False)
class WallPosterior:
    """A wall posterior has the field after its points, and the m nodes of the wall at which errors are joint:
    their places in the reference pose, and where they went (m, d) in the map frame.

    unfollowed (m, d): the part of the motion that is not followed, since the points do not show it for
    certain; inflation calibrates the deviations.
    """

    field: FieldPosterior
    nodes: Places
    where: Array
    unfollowed: Array
    inflation: float

    @cached_property
    def covariance(self) -> Array:
        """Covariance (m d, m d) of the nodes' errors, the axes of one node behind each other."""
        count, dim = self.where.shape
        directions = np.tile(np.eye(dim), (count, 1))
        asked = Observed(np.repeat(self.nodes.at, dim, axis=0), directions, self.nodes.normals.ravel())
        missed = self.unfollowed.ravel()
        return np.asarray(self.inflation**2 * (self.field.covariance(asked) + np.outer(missed, missed)))

    @cached_property
    def factor(self) -> Array:
        """The Cholesky factor F (m d, m d) of the covariance F F'."""
        joint = self.covariance.copy()
        joint[np.diag_indices_from(joint)] += SETTINGS.nugget * float(joint.max())
        return np.asarray(np.linalg.cholesky(joint))

    def at(self, places: Array) -> ErrorsAt:
        """Return the errors at places (n, d) of the map frame."""
        shortest = float(self.field.prior.covariance.lengths.min())
        return ErrorsAt(self, NodeSums.of(self.where, places, shortest))


@dataclass(frozen=True, eq=False)
class ErrorsAt:
    """Errors at n places are sums of those of the nodes."""

    posterior: WallPosterior
    sums: NodeSums

    def covariance(self) -> Array:
        """Return the covariance (n, d, d) of the error at each place."""
        return self.sums.covariance(self.posterior.covariance, self.posterior.where.shape[1])

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Return samples (count, n, d) of the errors."""
        factor = self.posterior.factor
        drawn = rng.standard_normal((count, factor.shape[1])) @ factor.T
        return self.sums.values(drawn.reshape(count, *self.posterior.where.shape))
