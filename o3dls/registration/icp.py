"""Iterative closest points: match, reject, weigh, step; again until the surface rests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import SolverError
from ..geometry.similarity import apply
from ..noise.robust import EFFICIENT_95, kernel_weights, robust_sd
from .match import Pairs, SurfaceMatcher
from .metrics import Factors, Metric
from .reject import Rule
from .step import Body, Freedom, best_motion

KEPT = 0.01  # a pair that weighs less is not counted as kept

Solver = Callable[[Factors, Array, Body, Freedom, float], Array]
"""Motion (d+1, d+1) of the surface from factors, weights (n,), body, freedom and the share of the step to
take.
"""

Belief = Callable[[Factors, float], Array]
"""Weights (n,) in [0, 1] of factors, under a loosening (>= 1) of the coarse-to-fine schedule."""


def equal(factors: Factors, loosening: float) -> Array:
    """Give every pair the same weight."""
    return np.ones(len(factors.pairs.points))


def m_estimator(kernel: str, width: float | None = None) -> Belief:
    """Return the weights of a robust kernel whose `width` is in robust standard deviations of the residuals
    (None: 95 % efficient).
    """
    factor = EFFICIENT_95[kernel] if width is None else width
    return lambda factors, loosening: kernel_weights(
        kernel, factors.residuals, factor * loosening * robust_sd(factors.residuals)
    )


def wall_or_cavity(radius: float) -> Belief:
    """Return the probability that a point lies on the wall, not in the cavity of a surface of this rms
    radius.
    """
    from ..noise.mixture import fit_mixture

    return lambda factors, loosening: fit_mixture(factors.pairs.signed, radius, loosening=loosening).weights


@dataclass(frozen=True)
class Recipe:
    """A recipe is what an ICP is made of: the metric, the freedom of the pose, the rules that reject pairs,
    the belief in those that are kept, and the solver of a step.
    """

    metric: Metric
    freedom: Freedom
    rules: tuple[Rule, ...] = ()
    belief: Belief = equal
    solve: Solver = best_motion

    def weights(self, factors: Factors, loosening: float) -> Array:
        """Return the product (n,) of the rules' masks and the beliefs."""
        pairs = factors.pairs
        keep = (
            np.logical_and.reduce([rule(pairs, loosening) for rule in self.rules])
            if self.rules
            else np.ones(len(pairs.points), dtype=bool)
        )
        if keep.sum() < pairs.points.shape[1]:
            raise SolverError(
                f"icp: the rejection rules keep {keep.sum()} of {len(keep)} pairs (closest "
                f"{pairs.distances.min():.3g}): "
                "loosen them, or begin nearer, such as with the stage global_pose"
            )
        return keep * self.belief(factors, loosening)


@dataclass(frozen=True)
class Criteria:
    """The criteria say when to stop: at a step (longest motion of a foot) below `tolerance`, or after
    `iterations`; thresholds fall from `coarse`-fold to one-fold over the first `anneal` iterations.
    """

    tolerance: float = 5e-3
    iterations: int = 100
    coarse: float = 1.0
    anneal: int = 0

    def loosening(self, iteration: int) -> float:
        return float(self.coarse ** max(0.0, 1.0 - iteration / self.anneal)) if self.anneal else 1.0


@dataclass(frozen=True, eq=False)
class Alignment:
    """An alignment says where ICP came to rest: pose, the pairs and weights (n,) there, one record per
    iteration.
    """

    T_map_prior: Array
    pairs: Pairs
    weights: Array
    trace: tuple[Mapping[str, float], ...]
    converged: bool


def align(
    points: Array, surface: SurfaceMatcher, T_map_prior: Array, recipe: Recipe, criteria: Criteria
) -> Alignment:
    """Move `surface` from `T_map_prior` until it fits points (n, d). Raises SolverError where no step can be
    made.
    """
    trace: list[Mapping[str, float]] = []
    body = Body.of(surface.surface.vertices)
    pairs = surface.match(points, T_map_prior)
    converged = False
    moved = np.zeros_like(points)
    share = 1.0
    for iteration in range(criteria.iterations):
        loosening = criteria.loosening(iteration)
        factors = recipe.metric(pairs)
        weights = recipe.weights(factors, loosening)
        delta = recipe.solve(factors, weights, body.at(T_map_prior), recipe.freedom, share)
        last = moved
        moved = apply(delta, pairs.feet) - pairs.feet
        if not np.isfinite(moved).all():
            raise SolverError(f"icp: iteration {iteration + 1} gave a step that is not finite")
        trace.append(_record_step(pairs, weights, moved, loosening))
        T_map_prior = delta @ T_map_prior
        pairs = surface.match(points, T_map_prior, pairs)
        if trace[-1]["step"] <= criteria.tolerance and loosening == 1.0:
            converged = True
            break
        # a point hops between two walls, and the minimum is the kink between them: take half steps
        if _turns_back(last, moved):
            share *= 0.5
    weights = recipe.weights(recipe.metric(pairs), 1.0)
    return Alignment(T_map_prior, pairs, weights, tuple(trace), converged)


def _turns_back(last: Array, moved: Array) -> bool:
    """Say whether a step mostly undoes the one before."""
    return bool((last * moved).sum() < -0.5 * np.linalg.norm(last) * np.linalg.norm(moved))


def _record_step(pairs: Pairs, weights: Array, moved: Array, loosening: float) -> Mapping[str, float]:
    kept = weights > KEPT
    step = float(np.linalg.norm(moved, axis=1).max())
    rms = float(np.sqrt((weights @ pairs.distances**2) / weights.sum()))
    return {
        "pairs": int(kept.sum()),
        "rms": rms,
        "median": float(np.median(pairs.distances)),
        "step": step,
        "loosening": loosening,
    }
