"""Iterative closest points: match, reject, weigh, step; again until the surface rests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import SolverError
from ..geometry import Array, apply, fit_similarity
from .match import Pairs, SurfaceMatcher
from .metrics import Factors, Metric
from .reject import Rule
from .robust import EFFICIENT_95, kernel_weights, spread
from .step import Body, Freedom, best_motion


@dataclass(frozen=True)
class Kernel:
    """An M-estimator by name; `width` in robust standard deviations of the residuals (None: 95 % efficient)."""

    name: str
    width: float | None = None

    def weights(self, residuals: Array, loosening: float) -> Array:
        width = EFFICIENT_95[self.name] if self.width is None else self.width
        return kernel_weights(self.name, residuals, width * loosening * spread(residuals))


@dataclass(frozen=True)
class Criteria:
    """When to stop: a step (longest motion of a foot) below `tolerance`, or `iterations`; thresholds fall from `coarse`-fold to
    one-fold over the first `anneal` iterations."""

    tolerance: float = 5e-3
    iterations: int = 100
    coarse: float = 1.0
    anneal: int = 0

    def loosening(self, iteration: int) -> float:
        return float(self.coarse ** max(0.0, 1.0 - iteration / self.anneal)) if self.anneal else 1.0


@dataclass(frozen=True, eq=False)
class Alignment:
    """Where ICP came to rest: pose, the pairs and weights (n,) there, one record per iteration."""

    T_map_prior: Array
    pairs: Pairs
    weights: Array
    trace: tuple[Mapping[str, float], ...]
    converged: bool


def align(
    points: Array,
    surface: SurfaceMatcher,
    T_map_prior: Array,
    *,
    metric: Metric,
    rules: tuple[Rule, ...] = (),
    kernel: Kernel | None = None,
    freedom: Freedom,
    criteria: Criteria,
) -> Alignment:
    """Move `surface` from `T_map_prior` until it fits points (n, d). Raises SolverError where no step can be made."""
    trace: list[Mapping[str, float]] = []
    pairs, converged = surface.match(points, T_map_prior), False
    for iteration in range(criteria.iterations):
        loosening = criteria.loosening(iteration)
        factors = metric(pairs)
        weights = _weights(factors, rules, kernel, loosening)
        delta = best_motion(factors, weights, Body(T_map_prior, surface.radius), freedom)
        step = float(np.linalg.norm(apply(delta, pairs.feet) - pairs.feet, axis=1).max())
        if not np.isfinite(step):
            raise SolverError(f"icp: iteration {iteration + 1} gave a step that is not finite")
        trace.append(_record(pairs, weights, step, loosening))
        T_map_prior = delta @ T_map_prior
        pairs = surface.match(points, T_map_prior, pairs)
        if step <= criteria.tolerance and loosening == 1.0:
            converged = True
            break
    if freedom.strain_sd is not None:  # the strain was there so that it does not bend the pose: give the similarity nearest to it
        vertices = surface.surface.vertices
        T_map_prior = fit_similarity(vertices, apply(T_map_prior, vertices), scale=freedom.scale)
        pairs = surface.match(points, T_map_prior, pairs)
    return Alignment(T_map_prior, pairs, _weights(metric(pairs), rules, kernel, 1.0), tuple(trace), converged)


def _weights(factors: Factors, rules: tuple[Rule, ...], kernel: Kernel | None, loosening: float) -> Array:
    """Product of the rules' masks and the kernel's weights, (n,)."""
    pairs = factors.pairs
    keep = np.logical_and.reduce([rule(pairs, loosening) for rule in rules]) if rules else np.ones(len(pairs.points), dtype=bool)
    if keep.sum() < pairs.points.shape[1]:
        raise SolverError(
            f"icp: the rejection rules keep {keep.sum()} of {len(keep)} pairs (closest {pairs.distances.min():.3g}): "
            "loosen them or begin nearer"
        )
    weights = keep.astype(np.float64)
    if kernel is not None:
        weights[keep] = kernel.weights(factors.residuals[keep], loosening)
    return weights


def _record(pairs: Pairs, weights: Array, step: float, loosening: float) -> Mapping[str, float]:
    kept = weights > 0.0
    rms = float(np.sqrt((weights @ pairs.distances**2) / weights.sum()))
    return {"pairs": int(kept.sum()), "rms": rms, "median": float(np.median(pairs.distances)), "step": step, "loosening": loosening}
