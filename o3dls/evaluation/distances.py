"""How good an estimate is: exact point-to-surface distances, kept apart by what the estimate has seen and
what it has not.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..case import Case
from ..estimate import Estimate
from ..geometry.similarity import apply
from ..geometry.surface import Surface

SAMPLES = 20_000  # area-uniform samples of a surface
SAMPLING_SEED = 613_942_071
DICE_CELLS = 100  # along the longest side of the box: 1e6 cells in 3D

Record = dict[str, float | int | None]


def distances(points: Array, surface: Surface) -> Array:
    """Return exact unsigned distances (n,) of points (n, d) to the triangles or segments of a surface."""
    return surface.closest_point.distance(points)


def sample(surface: Surface, count: int = SAMPLES, seed: int = SAMPLING_SEED) -> Array:
    """Return points (count, d) spread uniformly over the area of a surface; the same seed gives the same
    points.
    """
    rng = np.random.default_rng(seed)
    area = np.cumsum(surface.face_areas)
    faces = surface.faces[np.searchsorted(area, rng.uniform(0.0, area[-1], count), side="right")]
    weights = rng.exponential(size=(count, surface.dimension))
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("nk,nkd->nd", weights, surface.vertices[faces]))


def summary(values: Array, unit: str) -> Record:
    """Return `{n, mean_mm, median_mm, rms_mm, p95_mm, max_mm}` of distances (n,)."""
    found = {
        "mean": values.mean(),
        "median": np.median(values),
        "rms": np.sqrt((values**2).mean()),
        "p95": np.percentile(values, 95.0),
        "max": values.max(),
    }
    return {"n": len(values)} | {f"{name}_{unit}": float(value) for name, value in found.items()}


def measure(case: Case, estimate: Estimate, fitted: tuple[str, ...]) -> dict[str, Array]:
    """Return distances by set; `fitted` are the point types that this estimate, or one that it started from,
    was shown.

    Sets never mix: a point is scored as fitted where the estimate saw its type, and an empty set is left out.
    """
    truth = case.truth
    sets = {
        "fitted": distances(case.points.of(*scored_as_fitted(fitted)).xyz, estimate.surface),
        "landmarks": landmark_errors(case, estimate),
    }
    if "ablation" not in fitted:
        sets["ablation"] = distances(case.points.of("ablation").xyz, estimate.surface)
    if truth is not None and truth.held_out is not None:
        sets |= _held_out(truth.held_out, truth.unseen, estimate.surface)
    if truth is not None and truth.correspondence is not None:
        prior, position = truth.correspondence
        sets["correspondence"] = _vector_lengths(moved(estimate, prior) - position)
    if truth is not None and truth.surface is not None:
        sets["truth_to_surface"], sets["surface_to_truth"] = _measure_both_ways(
            truth.surface, estimate.surface
        )
    return {name: values for name, values in sets.items() if len(values)}


@lru_cache(maxsize=1)  # estimates that follow each other may share their surface
def _measure_both_ways(truth: Surface, surface: Surface) -> tuple[Array, Array]:
    return distances(sample(truth), surface), distances(sample(surface), truth)


def scored_as_fitted(fitted: tuple[str, ...]) -> tuple[str, ...]:
    """Return the point types of the set `fitted`: `inside` points bound the surface from one side, so their
    distance is no error.
    """
    return tuple({"eam", *fitted} - {"inside"})


def landmark_errors(case: Case, estimate: Estimate) -> Array:
    """Return distances (k,) between the moved landmarks of the prior and the measured ones of the same
    name.
    """
    _, prior, measured = case.landmark_pairs()
    return _vector_lengths(moved(estimate, prior) - measured)


def moved(estimate: Estimate, prior_points: Array) -> Array:
    """Return points (n, d) of the prior in the map frame: by the motion where there is one, else by the
    similarity.
    """
    return estimate.motion(prior_points) if estimate.motion else apply(estimate.T_map_prior, prior_points)


def truth_scores(sets: Mapping[str, Array], surface: Surface, truth: Surface, unit: str) -> Record:
    """Return `{assd, hd95, dice, within_1, within_2, within_3}`; hd95 is the larger of both directions, dice
    None where truth is open.
    """
    to_surface, to_truth = sets["truth_to_surface"], sets["surface_to_truth"]
    return {
        f"assd_{unit}": float((to_surface.mean() + to_truth.mean()) / 2.0),
        f"hd95_{unit}": float(max(np.percentile(to_surface, 95.0), np.percentile(to_truth, 95.0))),
        "dice": dice(surface, truth) if truth.watertight else None,
    } | {f"within_{k}{unit}": float((to_surface <= k).mean()) for k in (1, 2, 3)}


@lru_cache(maxsize=1)
def dice(a: Surface, b: Surface) -> float:
    """Return the overlap 2|A and B| / (|A| + |B|) of what two closed surfaces enclose, counted on one grid of
    cell centres.
    """
    both = np.vstack([a.vertices, b.vertices])
    low = both.min(axis=0)
    span = np.ptp(both, axis=0)
    step = span.max() / DICE_CELLS
    axes = [
        start + step * (np.arange(np.ceil(length / step)) + 0.5)
        for start, length in zip(low, span, strict=True)
    ]
    in_a, in_b = occupancy(a, axes), occupancy(b, axes)
    return float(2.0 * (in_a & in_b).sum() / max(in_a.sum() + in_b.sum(), 1))


def occupancy(surface: Surface, axes: list[Array]) -> NDArray[np.bool_]:
    """Return True at the nodes of the grid of `axes` (one array of evenly spaced coordinates per dimension)
    that a closed surface encloses.
    """
    from ..levelset.grid.winding import winding

    shape = np.array([*map(len, axes), 1][:3])
    local = np.zeros((len(surface.vertices), 3))
    for k, axis in enumerate(axes):
        local[:, k] = (surface.vertices[:, k] - axis[0]) / (axis[-1] - axis[0]) * (len(axis) - 1)
    nodes = np.indices(tuple(shape), dtype=np.int32).reshape(3, -1).T
    number, _ = winding(np.ascontiguousarray(nodes), local, surface.faces, shape)
    return np.asarray((number != 0).reshape(tuple(map(len, axes))))


def _held_out(points: Array, unseen: NDArray[np.bool_] | None, surface: Surface) -> dict[str, Array]:
    gap = distances(points, surface)
    if unseen is None:
        return {"held_out": gap}
    return {"held_out": gap, "held_out_seen": gap[~unseen], "held_out_unseen": gap[unseen]}


def _vector_lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=1))
