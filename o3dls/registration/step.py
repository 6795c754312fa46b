"""One step of ICP: the motion of the surface that brings it nearest to its pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import Array, apply, fit_similarity, scale_of, similarity
from .metrics import Factors
from .pose import Twist, strain_of


@dataclass(frozen=True)
class Freedom:
    """What the motion may do. Log scale and strain are pulled to zero with standard deviations `scale_sd` (None: not pulled) and
    `strain_sd` (None: no strain); a direction whose uncertainty, as rms motion of the surface over its radius, exceeds `freeze`
    is left where it is."""

    scale: bool = False
    scale_sd: float | None = None
    scale_bounds: tuple[float, float] = (0.0, np.inf)
    strain_sd: float | None = None
    freeze: float | None = None

    def twist(self, d: int) -> Twist:
        return Twist(d, self.strain_sd is not None, self.scale)


@dataclass(frozen=True, eq=False)
class Body:
    """The moving surface as far as a step must know it: its pose, and its rms radius in the prior frame."""

    T_map_prior: Array
    radius: float

    @property
    def log_scale(self) -> float:
        return float(np.log(scale_of(self.T_map_prior)))


def best_motion(factors: Factors, weights: Array, body: Body, freedom: Freedom, share: float = 1.0) -> Array:
    """Matrix (d+1, d+1) of the motion that lessens the factors: the minimum where it is known in closed form, else a `share` of a
    Newton step."""
    if factors.closed_form and freedom.freeze is None and freedom.strain_sd is None:
        return _closed_form(factors, weights, body, freedom)
    return _newton(factors, weights, body, freedom, share)


def _closed_form(factors: Factors, weights: Array, body: Body, freedom: Freedom) -> Array:
    """Weighted Procrustes (Umeyama 1991); the best rotation does not depend on the scale, so the scale's law is applied after it."""
    feet, points = factors.pairs.feet, factors.pairs.points
    best = fit_similarity(feet, points, weights, scale=freedom.scale)
    if not freedom.scale:
        return best
    share = weights / weights.sum()
    centre, target = share @ feet, share @ points
    turn = best[:-1, :-1] / scale_of(best)
    log_scale = np.log(scale_of(best)) + body.log_scale
    if freedom.scale_sd is not None:
        precision = weights @ ((feet - centre) ** 2).sum(axis=1) / _noise(factors, weights) ** 2
        log_scale *= precision / (precision + freedom.scale_sd**-2)
    factor = np.exp(_bounded(log_scale, freedom) - body.log_scale)
    return similarity(turn, target - factor * turn @ centre, factor)


def _newton(factors: Factors, weights: Array, body: Body, freedom: Freedom, share: float) -> Array:
    """Gauss-Newton step about the middle of the feet, in units of rms surface motion so that lengths and angles compare."""
    feet = factors.pairs.feet
    twist, centre, noise = freedom.twist(feet.shape[1]), feet.mean(axis=0), _noise(factors, weights)
    hessian, gradient = normal_equations(factors, weights, twist, centre)
    _pull(hessian, gradient, noise, body, freedom)
    units = np.ones(twist.size)
    units[twist.d :] /= body.radius * np.exp(body.log_scale)
    hessian, gradient = hessian * np.outer(units, units), gradient * units
    step = _solve(hessian, gradient, noise, freedom.freeze, body)
    if freedom.scale:
        allowed = (_bounded(body.log_scale + step[-1] * units[-1], freedom) - body.log_scale) / units[-1]
        if abs(allowed - step[-1]) > 1e-9 * body.radius:  # held at a bound: the rest is solved again
            rest = _solve(hessian[:-1, :-1], gradient[:-1] - hessian[:-1, -1] * allowed, noise, freedom.freeze, body)
            step = np.append(rest, allowed)
    return twist.motion(share * units * step, centre)


def nearest_similarity(T_map_prior: Array, vertices: Array, freedom: Freedom) -> Array:
    """The similarity that moves vertices (n, d) most like an affine matrix does, with a scale that `freedom` allows."""
    target = apply(T_map_prior, vertices)
    best = fit_similarity(vertices, target)
    turn = best[:-1, :-1] / scale_of(best)
    factor = np.exp(_bounded(np.log(scale_of(best)), freedom)) if freedom.scale else scale_of(T_map_prior)
    return similarity(turn, target.mean(axis=0) - factor * turn @ vertices.mean(axis=0), float(factor))


def normal_equations(factors: Factors, weights: Array, twist: Twist, centre: Array) -> tuple[Array, Array]:
    """Hessian (k, k) and descent gradient (k,) of half the metric over a twist about `centre`."""
    pairs = factors.pairs
    tangent = twist.tangent(pairs.feet, centre, turned=pairs.feet + factors.lever * pairs.gaps)
    pulled = np.matmul(weights[:, None, None] * factors.information, tangent)
    return np.tensordot(pulled, tangent, axes=((0, 1), (0, 1))), np.tensordot(pulled, pairs.gaps, axes=((0, 1), (0, 1)))


def _pull(hessian: Array, gradient: Array, noise: float, body: Body, freedom: Freedom) -> None:
    """Add what is believed of scale and strain beforehand, in place."""
    if freedom.scale and freedom.scale_sd is not None:
        precision = (noise / freedom.scale_sd) ** 2
        hessian[-1, -1] += precision
        gradient[-1] -= precision * body.log_scale
    if freedom.strain_sd is not None:
        precision, rows = (noise / freedom.strain_sd) ** 2, freedom.twist(len(body.T_map_prior) - 1).strains
        hessian[rows, rows] += precision * np.eye(rows.stop - rows.start)
        gradient[rows] -= precision * strain_of(body.T_map_prior)


def _solve(hessian: Array, gradient: Array, noise: float, freeze: float | None, body: Body) -> Array:
    """Solve over the directions that are determined: all that have curvature, or those certain to within `freeze` radii."""
    values, vectors = np.linalg.eigh(hessian)
    floor = max(values[-1] * 1e-12, 1e-300)
    if freeze is not None:
        floor = max(floor, (noise / (freeze * body.radius * np.exp(body.log_scale))) ** 2)
    return np.asarray(vectors @ np.where(values > floor, (vectors.T @ gradient) / np.maximum(values, floor), 0.0))


def _noise(factors: Factors, weights: Array) -> float:
    """Weighted rms of the residuals; never zero."""
    return float(max(np.sqrt(weights @ factors.residuals**2 / weights.sum()), 1e-12))


def _bounded(log_scale: float, freedom: Freedom) -> float:
    low, high = freedom.scale_bounds
    return float(np.clip(log_scale, np.log(max(low, 1e-300)), np.log(high)))
