"""The motion beside the wall: the posterior mean of a vector Gaussian process, given how the wall moved.

A place x of the prior frame goes to S (x + u(x)), with the similarity S = `T_map_prior`. At the vertices v_i
of the prior, u(v_i) = S^-1 T(v_i) - v_i is known; elsewhere

    u(x) = w(x) k(x)' (K + nugget I)^-1 u(v),      k: the vector fields' Matern 5/2 of the fit (`covariance`)

with a window w that is 1 in the box around the wall and falls to 0 at the `reach` outside of it, so that far
away only the similarity is left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from ...arrays import Array, Ints, Mask
from ...errors import SolverError
from ...geometry.similarity import apply, inverse, rms_radius, scale_of
from ...parallel import by_rows
from ..field.covariance import WORTH
from ..field.kernels import add_correlated, matern
from ..problem import space_points
from ..recorded import RecordedMotion
from ..settings import CovarianceSettings
from .inverse import Inverted, determinants, fixed_point
from .settings import SETTINGS


@dataclass(frozen=True, eq=False)
class OffWall:
    """A motion off the wall takes any place of the prior frame to the map frame, and back (`Motion`).

    nodes (k, 3) are places of the wall, in the prior frame; pull (k, 3) are their weights; factor (k, k) is
    Cholesky's of their covariance of unit variance; amplitude is the rms of the wall's displacement along an
    axis, in the prior's unit; reach is the longest correlation length.
    """

    motion: RecordedMotion
    lengths: Array
    variances: Array
    nodes: Array
    pull: Array
    factor: Array
    amplitude: float

    @property
    def reach(self) -> float:
        return float(self.lengths.max())

    @property
    def T_map_prior(self) -> Array:
        return self.motion.T_map_prior

    def __call__(self, points: Array) -> Array:
        return apply(self.T_map_prior, points + self.displacement(points))

    def displacement(self, points: Array) -> Array:
        """Return u (n, 3), in the prior frame, at places (n, 3) of it."""
        return self.window(points)[:, None] * self._unwindowed(points)

    def inverse(self, points: Array) -> Inverted:
        """Return which places (n, 3) of the prior frame go to places (n, 3) of the map frame."""
        places, residual = self._shifted_back(points)
        return Inverted(places, residual, self.folded(places))

    def places(self, points: Array) -> Array:
        """Return the places (n, 3) of `inverse` alone, unchecked."""
        return self._shifted_back(points)[0]

    def folded(self, points: Array) -> Mask:
        """Return where (n,) the field folds space: its Jacobian's determinant is not positive."""
        step = SETTINGS.slope_step * rms_radius(self.motion.prior.vertices)
        return np.asarray(determinants(self.displacement, points, step) <= 0.0)

    def sd(self, points: Array, normals: Array | None = None) -> Array:
        """Return the standard deviation (n,), in units of the map, of where places (n, 3) went: that of the
        wall's nearest place along its normal, and what the wall does not tell of the field.
        """
        wall = self.motion.sd(points, self.motion.prior.vertices)
        return np.asarray(np.sqrt(wall**2 + self._beyond(points)))

    def known(self, points: Array) -> Mask:
        """Return where (n,) the wall tells how space moved: at least to half of the field's deviation."""
        limit = (SETTINGS.known * self.amplitude * scale_of(self.T_map_prior)) ** 2
        return np.asarray(self._beyond(points) <= limit)

    def window(self, points: Array) -> Array:
        """Return w (n,) at places (n, 3)."""
        low, high = self.box
        inward = np.minimum(points - low, high - points) / self.reach
        t = np.clip(inward, 0.0, 1.0)
        return np.asarray((t * t * (3.0 - 2.0 * t)).prod(axis=1))

    @cached_property
    def missed(self) -> Array:
        """By how much (n,) the field misses each vertex of the wall, in units of the map: more than rounding
        where the wall moved as no space around it can, as where it folds.
        """
        found = self(self.motion.prior.vertices)
        return np.asarray(np.linalg.norm(found - self.motion.moved.vertices, axis=1))

    @property
    def not_followed(self) -> str:
        """A sentence where the field does not follow the wall; empty where it does."""
        some = float(np.percentile(self.missed, SETTINGS.counted))
        if some <= SETTINGS.followed:
            return ""
        return (
            f"no field in space follows the moved wall: it misses it by {some:.2g} mm or more at "
            f"{100 - SETTINGS.counted:g} % of the vertices, by {self.missed.max():.2g} mm at most; the "
            "deviation holds that"
        )

    @cached_property
    def _missed_around(self) -> RecordedMotion:
        return replace(self.motion, deviation=self.missed)

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """The corners (3,) of the box outside of which the field is 0."""
        vertices = self.motion.prior.vertices
        return vertices.min(axis=0) - self.reach, vertices.max(axis=0) + self.reach

    def _shifted_back(self, points: Array) -> tuple[Array, Array]:
        posed = apply(inverse(self.T_map_prior), points)
        found = fixed_point(self.displacement, posed)
        return posed + found.shift, found.residual

    def _unwindowed(self, points: Array) -> Array:
        return _mean(points, self.nodes, self.pull, self.lengths, self.variances)

    def _beyond(self, points: Array) -> Array:
        """Return the variance (n,) beyond that of the wall, in units of the map: what the wall leaves of the
        field's, what the window takes off, and by how much the field misses the wall nearby.
        """
        explained = np.concatenate(
            [np.zeros(0)]
            + [
                self._explained(points[k : k + SETTINGS.at_once])
                for k in range(0, len(points), SETTINGS.at_once)
            ]
        )
        missed = self._missed_around.sd(points, self.motion.prior.vertices)
        taken_off = (1.0 - self.window(points)) * np.linalg.norm(self._unwindowed(points), axis=1)
        beyond = (1.0 - explained) * self.amplitude**2 + taken_off**2
        return np.asarray(beyond * scale_of(self.T_map_prior) ** 2 + missed**2)

    def _explained(self, points: Array) -> Array:
        crossed = _covariance(self.nodes, points, self.lengths, self.variances)
        half = solve_triangular(self.factor, crossed, lower=True, overwrite_b=True, check_finite=False)
        return np.asarray(np.clip(np.einsum("kn,kn->n", half, half), 0.0, 1.0))


class _System(NamedTuple):
    energy: float
    pull: Array
    factor: Array


def off_wall(motion: RecordedMotion) -> OffWall:
    """Return the motion in space that follows a motion of the wall."""
    prior = motion.prior.vertices
    shift = apply(inverse(motion.T_map_prior), motion.moved.vertices) - prior
    settings = CovarianceSettings()
    lengths = rms_radius(prior) * np.array(settings.vector_lengths)
    shares = 0.25 ** np.arange(len(lengths))
    variances = np.asarray(shares / shares.sum())
    nodes, system = _hold_wall(prior, shift, lengths, variances)
    amplitude = float(np.sqrt((shift**2).mean()))
    return OffWall(motion, lengths, variances, prior[nodes], system.pull, system.factor, amplitude)


def _hold_wall(places: Array, shift: Array, lengths: Array, variances: Array) -> tuple[Ints, _System]:
    """Return which places of the wall hold the field, and their weights: even ones first, then those that the
    field misses most.
    """
    spacing = SETTINGS.node_spacing * lengths.min()
    nodes = space_points(places, spacing)
    while len(nodes) > SETTINGS.most_even:
        spacing *= 1.2
        nodes = space_points(places, spacing)
    for more in (*SETTINGS.rounds, 0):
        system = _solve(_covariance(places[nodes], places[nodes], lengths, variances), shift[nodes])
        missed = np.linalg.norm(_mean(places, places[nodes], system.pull, lengths, variances) - shift, axis=1)
        worst = np.argsort(-missed)[:more]
        nodes_missed = worst[missed[worst] > SETTINGS.missed]
        if not len(nodes_missed):
            break
        nodes = np.unique(np.r_[nodes, nodes_missed])
    return nodes, system


def _mean(points: Array, nodes: Array, pull: Array, lengths: Array, variances: Array) -> Array:
    """Return the field (n, d) that nodes (k, d) pull with weights (k, d)."""
    out = np.zeros(points.shape)
    pulls = np.ascontiguousarray(variances[:, None, None] * pull.T)
    at = np.ascontiguousarray(points, dtype=np.float64)
    by_rows(add_correlated, WORTH, (at, out), nodes, lengths, pulls)
    return out


def _covariance(a: Array, b: Array, lengths: Array, variances: Array) -> Array:
    return np.asarray(
        sum(part * matern(a, b, length) for part, length in zip(variances, lengths, strict=True))
    )


def _solve(covariance: Array, held: Array) -> _System:
    """Return the weights (k, d) that give values (k, d), by the likeliest of some nuggets."""
    return min(
        (_with_nugget(covariance, held, nugget) for nugget in SETTINGS.nuggets), key=lambda one: one.energy
    )


def _with_nugget(covariance: Array, held: Array, nugget: float) -> _System:
    """Return a system with its -log evidence per axis, of the amplitude that makes it least."""
    matrix = covariance.copy()
    matrix[np.diag_indices_from(matrix)] += nugget
    try:
        factor = np.asarray(np.linalg.cholesky(matrix))
    except np.linalg.LinAlgError as error:
        raise SolverError("the places of the wall are too near to each other for a field in space") from error
    half = solve_triangular(factor, held, lower=True, check_finite=False)
    pull = solve_triangular(factor, half, lower=True, trans="T", check_finite=False)
    variance = max(float((half**2).mean()), np.finfo(np.float64).tiny)
    energy = 0.5 * len(held) * np.log(variance) + float(np.log(np.diag(factor)).sum())
    return _System(energy, pull, factor)
