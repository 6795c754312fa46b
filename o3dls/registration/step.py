"""One step of ICP: the motion of the surface that brings it nearest to its pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import Array, fit_similarity, scale_of, similarity
from .match import Pairs
from .metrics import Metric
from .pose import motion, tangent


@dataclass(frozen=True)
class Freedom:
    """What the motion may do: change scale or not, within `bounds`, log scale pulled to zero with standard deviation `sd`
    (None: not pulled); and the rms motion of the surface (a length) beyond whose uncertainty a direction is left where it is."""

    scale: bool = False
    sd: float | None = None
    bounds: tuple[float, float] = (0.0, np.inf)
    freeze: float | None = None


@dataclass(frozen=True, eq=False)
class Body:
    """The moving surface as far as a step must know it: its pose, and its rms radius in the prior frame."""

    T_map_prior: Array
    radius: float

    @property
    def scale(self) -> float:
        return scale_of(self.T_map_prior)


def best_motion(metric: Metric, pairs: Pairs, weights: Array, body: Body, freedom: Freedom) -> Array:
    """Matrix (d+1, d+1) of the motion that lessens the metric: the minimum where it is known in closed form, else a Newton step."""
    solve = _closed_form if metric.closed_form and freedom.freeze is None else _newton
    return solve(metric, pairs, weights, body, freedom)


def _closed_form(metric: Metric, pairs: Pairs, weights: Array, body: Body, freedom: Freedom) -> Array:
    """Weighted Procrustes (Umeyama 1991); the rotation does not depend on the scale, so the scale's law is applied after it."""
    best = fit_similarity(pairs.feet, pairs.points, weights, scale=freedom.scale)
    if not freedom.scale:
        return best
    share = weights / weights.sum()
    centre, target = share @ pairs.feet, share @ pairs.points
    turn = best[:-1, :-1] / scale_of(best)
    precision = weights @ ((pairs.feet - centre) ** 2).sum(axis=1) / _noise(metric, pairs, weights) ** 2
    log_scale = np.log(scale_of(best) * body.scale)
    if freedom.sd is not None:
        log_scale *= precision / (precision + freedom.sd**-2)
    factor = _bounded(log_scale, freedom) / body.scale
    return similarity(turn, target - factor * turn @ centre, factor)


def _newton(metric: Metric, pairs: Pairs, weights: Array, body: Body, freedom: Freedom) -> Array:
    """Gauss-Newton step about the middle of the feet, in units of rms surface motion so that lengths and angles compare."""
    d = pairs.feet.shape[1]
    centre = pairs.feet.mean(axis=0)
    hessian, gradient = normal_equations(metric, pairs, weights, centre, scale=freedom.scale)
    units = np.ones(len(gradient))
    units[d:] /= body.radius * body.scale
    noise = _noise(metric, pairs, weights)
    if freedom.scale and freedom.sd is not None:
        hessian[-1, -1] += (noise / freedom.sd) ** 2
        gradient[-1] -= (noise / freedom.sd) ** 2 * np.log(body.scale)
    reach = None if freedom.freeze is None else freedom.freeze / noise
    twist = units * _solve(hessian * np.outer(units, units), gradient * units, reach)
    if freedom.scale:
        wanted = float(np.log(_bounded(np.log(body.scale) + twist[-1], freedom) / body.scale))
        if abs(wanted - twist[-1]) > 1e-12:  # held at a bound: the rest is solved again
            rest = slice(0, -1)
            right = (gradient - hessian[:, -1] * wanted)[rest] * units[rest]
            twist = np.append(units[rest] * _solve((hessian * np.outer(units, units))[rest, rest], right, reach), wanted)
    return motion(twist, centre)


def normal_equations(metric: Metric, pairs: Pairs, weights: Array, centre: Array, *, scale: bool) -> tuple[Array, Array]:
    """Hessian (k, k) and descent gradient (k,) of half the metric over the twist (shift, rotation, log scale) about `centre`."""
    jacobian = tangent(pairs.feet + metric.lever * pairs.gaps, centre, scale=scale)
    weighted = np.einsum("n,nij,njk->nik", weights, metric.information(pairs), jacobian)
    return np.einsum("nik,nil->kl", weighted, jacobian), np.einsum("nik,ni->k", weighted, pairs.gaps)


def _solve(hessian: Array, gradient: Array, reach: float | None) -> Array:
    """Solve over the directions that are determined; with `reach`, only those uncertain by less (1/sqrt of the curvature)."""
    values, vectors = np.linalg.eigh(hessian)
    floor = max(values[-1] * 1e-12, 1e-300) if reach is None else max(reach**-2, values[-1] * 1e-12)
    return np.asarray(vectors @ np.where(values > floor, (vectors.T @ gradient) / np.maximum(values, floor), 0.0))


def _noise(metric: Metric, pairs: Pairs, weights: Array) -> float:
    """Weighted rms of the residuals."""
    return float(max(np.sqrt(weights @ metric.residuals(pairs) ** 2 / weights.sum()), 1e-9))


def _bounded(log_scale: float, freedom: Freedom) -> float:
    return float(np.clip(np.exp(log_scale), *freedom.bounds))
