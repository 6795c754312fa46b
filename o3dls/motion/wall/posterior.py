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
from numba import njit
from scipy import sparse

from ...arrays import Array
from ...parallel import by_rows
from ..field.covariance import Observed, Places, interpolation
from ..field.gaussian_process import FieldPosterior
from .settings import SETTINGS

WORTH = 1000  # places that are worth a thread


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

    def weights(self, places: Array) -> sparse.csr_matrix:
        """Return the matrix (n, m) that interpolates the nodes' errors at places (n, d) of the map frame."""
        shortest = float(self.field.prior.covariance.lengths.min())
        return interpolation(self.where, places, shortest, SETTINGS.neighbours)

    def covariance_at(self, places: Array) -> Array:
        """Return the covariance (n, d, d) of the errors at each of the places (n, d) of the map frame."""
        dim = self.where.shape[1]
        found = self.weights(places)
        near, share = (part.reshape(len(places), -1) for part in (found.indices, found.data))
        total = np.zeros((len(places), dim, dim))
        by_rows(_add_blocks, WORTH, (total, near, share), self.covariance)
        return total

    def errors(self, places: Array, count: int, rng: np.random.Generator) -> Array:
        """Return samples (count, n, d) of the errors at places (n, d) of the map frame."""
        drawn = rng.standard_normal((count, self.factor.shape[1])) @ self.factor.T
        nodes = drawn.reshape(count, *self.where.shape).swapaxes(0, 1).reshape(len(self.where), -1)
        spread = self.weights(places) @ nodes
        return np.asarray(spread.reshape(len(places), count, -1).swapaxes(0, 1))


@njit(cache=True, nogil=True)
def _add_blocks(total, near, share, covariance):  # type: ignore[no-untyped-def]
    """Add to total (n, d, d) the covariance (m d, m d) of the nodes near (n, k) to each place, by their
    shares (n, k).
    """
    dim = total.shape[1]
    for v in range(len(total)):
        for i in range(near.shape[1]):
            for j in range(near.shape[1]):
                both = share[v, i] * share[v, j]
                for a in range(dim):
                    for b in range(dim):
                        total[v, a, b] += both * covariance[dim * near[v, i] + a, dim * near[v, j] + b]
