"""One step of ICP: the motion of the surface that brings it nearest to its pairs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..geometry.similarity import apply, fit_similarity, rms_radius, scale_of, similarity
from ..geometry.twist import Twist, strains
from .metrics import Factors


@dataclass(frozen=True)
class Freedom:
    """The freedom says what the motion of one step may do. Log scale is pulled to zero with standard
    deviation `scale_sd` (None: not pulled). With `strain_sd` the body may strain by so much while a step is
    found, so that uneven stretch does not pull the pose; the strain is not kept. A direction whose
    uncertainty, as rms motion of the surface over its radius, exceeds `freeze` is left where it is.
    """

    scale: bool = False
    scale_sd: float | None = None
    scale_bounds: tuple[float, float] = (0.0, np.inf)
    strain_sd: float | None = None
    freeze: float | None = None


@dataclass(frozen=True, eq=False)
class Body:
    """The body is what moves: vertices' middle (d,), rms radius and strain generators (k, d, d) in the prior
    frame, and the pose.
    """

    middle: Array
    radius: float
    strains: Array
    T_map_prior: Array

    @classmethod
    def of(cls, vertices: Array) -> Body:
        """Return the body of vertices (n, d), where it rests."""
        return cls(
            vertices.mean(axis=0), rms_radius(vertices), strains(vertices), np.eye(vertices.shape[1] + 1)
        )

    def at(self, T_map_prior: Array) -> Body:
        return replace(self, T_map_prior=T_map_prior)

    @property
    def scale(self) -> float:
        return scale_of(self.T_map_prior)

    @property
    def log_scale(self) -> float:
        return float(np.log(self.scale))

    def strained(self, positions: Array) -> Array:
        """Return the velocity (n, d, k) of positions (n, d) in the map frame under the unit strains."""
        turn = self.T_map_prior[:-1, :-1] / self.scale
        arm = (positions - apply(self.T_map_prior, self.middle[None])) @ turn
        return np.asarray(np.einsum("ij,gjk,nk->nig", turn, self.strains, arm))


def best_motion(factors: Factors, weights: Array, body: Body, freedom: Freedom, share: float = 1.0) -> Array:
    """Return the matrix (d+1, d+1) of the motion that lessens the factors: the minimum where it is known in
    closed form, else a `share` of a Newton step.
    """
    if factors.closed_form and freedom.freeze is None and freedom.strain_sd is None:
        return _closed_form(factors, weights, body, freedom)
    return _newton_step(factors, weights, body, freedom, share)


def _closed_form(factors: Factors, weights: Array, body: Body, freedom: Freedom) -> Array:
    """Solve weighted Procrustes (Umeyama 1991); the best rotation does not depend on the scale, so the
    scale's law is applied after it.
    """
    feet, points = factors.pairs.feet, factors.pairs.points
    best = fit_similarity(feet, points, weights, scale=freedom.scale)
    if not freedom.scale:
        return best
    share = weights / weights.sum()
    centre, target = share @ feet, share @ points
    turn = best[:-1, :-1] / scale_of(best)
    log_scale = np.log(scale_of(best)) + body.log_scale
    if freedom.scale_sd is not None:
        precision = weights @ ((feet - centre) ** 2).sum(axis=1) / _residual_rms(factors, weights) ** 2
        log_scale *= precision / (precision + freedom.scale_sd**-2)
    factor = np.exp(_bound_scale(log_scale, freedom) - body.log_scale)
    return similarity(turn, target - factor * turn @ centre, factor)


def _newton_step(factors: Factors, weights: Array, body: Body, freedom: Freedom, share: float) -> Array:
    """Make a Gauss-Newton step about the middle of the feet, in units of rms surface motion so that lengths
    and angles compare.
    """
    feet = factors.pairs.feet
    twist = Twist(feet.shape[1], freedom.scale)
    centre = feet.mean(axis=0)
    noise = _residual_rms(factors, weights)
    velocities = velocity(factors, twist, centre)
    if freedom.strain_sd is None:
        hessian, gradient = normal_equations(factors, weights, velocities)
    else:
        both = np.concatenate([velocities, body.strained(feet)], axis=2)
        hessian, gradient = _without_strain(
            *normal_equations(factors, weights, both), twist.size, noise / freedom.strain_sd
        )
    if freedom.scale and freedom.scale_sd is not None:
        precision = (noise / freedom.scale_sd) ** 2
        hessian[-1, -1] += precision
        gradient[-1] -= precision * body.log_scale
    units = np.ones(twist.size)
    units[twist.d :] /= body.radius * body.scale
    hessian = hessian * np.outer(units, units)
    gradient = gradient * units
    least = 0.0 if freedom.freeze is None else (noise / (freedom.freeze * body.radius * body.scale)) ** 2
    step = _solve_determined(hessian, gradient, least)
    if freedom.scale:
        allowed = (_bound_scale(body.log_scale + step[-1] * units[-1], freedom) - body.log_scale) / units[-1]
        # where the scale is at its bound, the rest is solved again
        if abs(allowed - step[-1]) > 1e-9 * body.radius:
            step = np.append(
                _solve_determined(hessian[:-1, :-1], gradient[:-1] - hessian[:-1, -1] * allowed, least),
                allowed,
            )
    return twist.motion(share * units * step, centre)


def _without_strain(hessian: Array, gradient: Array, k: int, stiffness: float) -> tuple[Array, Array]:
    """Return the equations of the first k unknowns once the others, held to zero with this stiffness, took up
    what they can (Schur complement).
    """
    own = hessian[k:, k:] + stiffness**2 * np.eye(len(hessian) - k)
    taken = np.linalg.solve(own, np.column_stack([hessian[k:, :k], gradient[k:]]))
    return hessian[:k, :k] - hessian[:k, k:] @ taken[:, :-1], gradient[:k] - hessian[:k, k:] @ taken[:, -1]


def velocity(factors: Factors, twist: Twist, centre: Array) -> Array:
    """Return the velocity (n, d, size) of the feet under a twist about `centre`, turned where the metric's
    lever says.
    """
    pairs = factors.pairs
    return twist.tangent(pairs.feet, centre, turned=pairs.feet + factors.lever * pairs.gaps)


def normal_equations(factors: Factors, weights: Array, velocities: Array) -> tuple[Array, Array]:
    """Return the Hessian (k, k) and descent gradient (k,) of half the metric over motions with these
    velocities (n, d, k) of the feet.
    """
    pulled = np.matmul(weights[:, None, None] * factors.information, velocities)
    return np.tensordot(pulled, velocities, axes=((0, 1), (0, 1))), np.tensordot(
        pulled, factors.pairs.gaps, axes=((0, 1), (0, 1))
    )


def _solve_determined(hessian: Array, gradient: Array, least: float) -> Array:
    """Solve over the directions that are determined: those with more curvature than `least` and than
    rounding.
    """
    values, vectors = np.linalg.eigh(hessian)
    floor = max(least, values[-1] * 1e-12, 1e-300)
    return np.asarray(
        vectors @ np.where(values > floor, (vectors.T @ gradient) / np.maximum(values, floor), 0.0)
    )


def _residual_rms(factors: Factors, weights: Array) -> float:
    """Return the weighted rms of the residuals, which is never zero."""
    return float(max(np.sqrt(weights @ factors.residuals**2 / weights.sum()), 1e-12))


def _bound_scale(log_scale: float, freedom: Freedom) -> float:
    low, high = freedom.scale_bounds
    return float(np.clip(log_scale, np.log(max(low, 1e-300)), np.log(high)))
