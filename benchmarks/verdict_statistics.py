"""Numbers that a check could use of a run, none of which needs the truth: for benchmarks.verdict.

Lengths in mm. `far_*`: wall without points near it; `resid_*`: mapping points against an estimate, outward
positive; `apart_a_b`: mean distance between two estimates, both ways; `left_*`: points left out in blocks,
which the motion predicts without a refit from the posterior of its last round.

With C the covariance of the rows' residuals, noise included, and alpha = C^-1 z, rows B left out together
are predicted with residual [C^-1]_BB^-1 alpha_B and covariance [C^-1]_BB^-1 (Rasmussen and Williams 2006,
5.12). Feet, amplitudes, noise and beliefs stay as they were, so this is kinder than a refit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from o3dls.arrays import Array, Ints, Mask
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import distances, landmark_errors, sample
from o3dls.evaluation.left_out import blocks
from o3dls.geometry.surface import Surface
from o3dls.runs.run import Run
from o3dls.runs.surface_fields import with_fields

Statistics = dict[str, Any]
BEYOND = (10.0, 15.0, 20.0, 25.0)  # mm from every point
SAMPLES = 4000
STRETCHES = (1.5, 2.0, 3.0)
PAIRS = (("start", "icp"), ("icp", "deform"), ("deform", "final"), ("icp", "final"))
NEIGHBOURS = 6
BELIEVED = 3.0  # noise levels, from which on a row's own noise is that of a point that is not believed
BLOCKS = (1, 8, 16, 32)  # rows per block: alone, and neighbours together


def statistics(run: Run) -> Statistics:
    """All of them, as JSON holds them; what a run does not have is left out, as a run that was read from its
    folder has no fit.
    """
    named = dict(run.estimates) | {"final": run.estimates[run.final]}
    found: Statistics = {"final": run.final, "icp_pose": named["icp"].T_map_prior.tolist()}
    for name, estimate in named.items():
        found |= _describe_estimate(run, name, estimate)
    found |= _describe_wall(run, named["final"])
    if "deform" in named:
        found |= _describe_outliers(run, named["deform"]) | _measure_stretch(run, named["deform"])
        found |= left_out_statistics(named["deform"])
    for a, b in PAIRS:
        if a in named and b in named:
            found[f"apart_{a}_{b}"] = _measure_gap(named[a].surface, named[b].surface)
    return {key: _convert_scalar(value) for key, value in found.items()}


def _convert_scalar(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _describe_estimate(run: Run, name: str, estimate: Estimate) -> Statistics:
    """What the estimate says of itself, and how points and landmarks lie to it."""
    found: Statistics = {
        f"{name}_sigma": estimate.sigma,
        f"{name}_converged": int(estimate.converged),
        f"{name}_seconds": estimate.seconds,
        f"{name}_status": estimate.status,
        f"{name}_scale": estimate.scale,
        f"{name}_area": estimate.surface.area,
        f"{name}_volume": estimate.surface.volume if estimate.surface.watertight else None,
    }
    facts = {key: value for key, value in estimate.facts.items() if isinstance(value, int | float | bool)}
    found |= {f"{name}_{key}": float(value) for key, value in facts.items()}
    found |= {f"{name}_{key}": value for key, value in (estimate.trace or ({},))[-1].items()}
    return found | _compare_with_points(run, name, estimate)


def _compare_with_points(run: Run, name: str, estimate: Estimate) -> Statistics:
    """How mapping points, ablation points and landmarks lie to the estimate."""
    found: Statistics = {}
    signed = _measure_signed(run.case.points.of("eam").xyz, estimate.surface)
    found |= {f"resid_{name}_{key}": value for key, value in _summarise_residuals(signed).items()}
    found |= _correlate_residuals(name, run.case.points.of("eam").xyz, signed)
    if len(burnt := run.case.points.of("ablation").xyz):
        found[f"ablation_{name}"] = distances(burnt, estimate.surface).mean()
    marks = landmark_errors(run.case, estimate)
    if len(marks):
        found |= {f"marks_{name}_rms": np.sqrt((marks**2).mean()), f"marks_{name}_max": marks.max()}
    alone = [one["leave_one_out"] for one in estimate.facts.get("landmarks", {}).values()]
    if alone and None not in alone:
        found["marks_alone_max"] = max(alone)
    return found


def _measure_signed(points: Array, surface: Surface) -> Array:
    """Distances (n,), positive outside of the wall next to each point."""
    squared, face, foot, _ = surface.closest_point.query(points)
    side = np.sign(((points - foot) * surface.face_normals[face]).sum(axis=1))
    return np.asarray(np.sqrt(squared) * side)


def _summarise_residuals(signed: Array) -> Statistics:
    size = np.abs(signed)
    quantiles = {f"q{q}": np.percentile(size, q) for q in (50, 75, 90, 95, 99)}
    beyond = {f"beyond_{far}": (size > far).mean() for far in (3, 5, 10)}
    inside = {f"inside_{far}": (signed < -far).mean() for far in (3, 5)}
    return {"mean": size.mean(), "signed_mean": signed.mean(), **quantiles, **beyond, **inside}


def _correlate_residuals(name: str, points: Array, signed: Array) -> Statistics:
    """Correlation of residuals along the order of the points, and between neighbours in space that were not
    taken one after the other; of those within three robust deviations.
    """
    from scipy.spatial import cKDTree

    limit = 3.0 * 1.4826 * np.median(np.abs(signed)) + 1e-9
    kept = np.clip(signed, -limit, limit) - np.clip(signed, -limit, limit).mean()
    scale = float((kept**2).mean()) + 1e-12
    rows = cKDTree(points).query(points, NEIGHBOURS + 1)[1][:, 1:]
    other = np.abs(rows - np.arange(len(points))[:, None]) > 20
    products = kept[:, None] * kept[rows]
    found = {f"order_{name}_{lag}": (kept[lag:] * kept[:-lag]).mean() / scale for lag in (1, 3, 8)}
    found[f"space_{name}"] = products.mean() / scale
    found[f"space_other_{name}"] = products[other].mean() / scale if other.any() else None
    half = len(kept) // 2
    found[f"halves_{name}"] = abs(kept[:half].mean() - kept[half:].mean())
    return found


def _describe_wall(run: Run, final: Estimate) -> Statistics:
    """Deviation of the final wall, and its parts without points."""
    surface = with_fields(run.case, final, run.fitted.get(run.final, ()))
    gap = surface.fields[f"distance_to_nearest_point_{run.unit}"]
    area = surface.vertex_areas / surface.vertex_areas.sum()
    found: Statistics = {f"far_share_{far:g}": float(area @ (gap > far)) for far in BEYOND}
    found |= {"far_reach": gap.max(), "gap_mean": float(area @ gap)} | _describe_far_part(surface, gap, area)
    sd = surface.fields.get(f"sd_{run.unit}")
    if sd is not None:
        known = np.where(np.isfinite(sd), sd, 0.0)
        found |= {"sd_mean": float(area @ known), "sd_max": known.max(), "sd_q95": np.percentile(known, 95)}
        found["sd_unknown"] = float(area @ ~np.isfinite(sd))
    moved = surface.fields.get(f"displacement_{run.unit}")
    if moved is not None:
        found |= {"moved_rms": np.sqrt(area @ moved**2), "moved_max": np.abs(moved).max()}
    return found | {f"validity_{key}": v for key, v in run.validity[run.final].items() if v is not None}


def _describe_far_part(surface: Surface, gap: Array, area: Array) -> Statistics:
    """The connected part of the wall farther than 10 mm from all points whose farthest vertex is farthest:
    its share of the area, its area, its widest extent, and how much of a pocket it is: the square of its rim
    over 4 pi of its area, 1 for a flat disc, .5 for half a ball, far less for a tube or a ball on a neck.
    """
    from scipy import sparse
    from scipy.sparse.csgraph import connected_components

    far = gap > BEYOND[0]
    edges = np.vstack([surface.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    edges = edges[far[edges].all(axis=1)]
    n = len(gap)
    graph = sparse.coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    label = connected_components(graph, directed=False)[1]
    part = (label == label[gap.argmax()]) & far
    extent = np.ptp(surface.vertices[part], axis=0).max() if part.any() else 0.0
    size, rim = float(area @ part) * surface.area, _measure_rim(surface, part)
    pocket = rim**2 / (4.0 * np.pi * size) if size > 0.0 else None
    return {
        "far_part_share": float(area @ part),
        "far_part_extent": float(extent),
        "far_part_area": size,
        "far_part_pocket": pocket,
    }


def _measure_rim(surface: Surface, part: Mask) -> float:
    """Length of the border of a part of the vertices (n,): of edges between faces within it and others."""
    inside = part[surface.faces].all(axis=1)
    directed = [surface.faces[inside][:, pair] for pair in ([0, 1], [1, 2], [2, 0])]
    edges = np.vstack(directed)
    n = len(surface.vertices)
    lone = ~np.isin(edges[:, 0] * n + edges[:, 1], edges[:, 1] * n + edges[:, 0])
    ends = surface.vertices[edges[lone]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum())


def _describe_outliers(run: Run, deform: Estimate) -> Statistics:
    """Points that are not believed: how many, on which side, how deep, whether their neighbours are not
    believed either.
    """
    from scipy.spatial import cKDTree

    if deform.weights is None or len(deform.weights) != len(points := run.case.points.of("eam").xyz):
        return {}
    doubted = deform.weights < 0.5
    found: Statistics = {"doubted": doubted.mean(), "believed": deform.weights.mean()}
    if not doubted.any():
        return found
    signed = _measure_signed(points[doubted], deform.surface)
    rows = cKDTree(points).query(points[doubted], NEIGHBOURS + 1)[1][:, 1:]
    depth = {f"doubted_depth_{q}": np.percentile(np.abs(signed), q) for q in (50, 90, 100)}
    return found | {"doubted_outside": (signed > 0).mean(), "doubted_together": doubted[rows].mean(), **depth}


def _measure_stretch(run: Run, deform: Estimate) -> Statistics:
    """How the motion stretches the wall beyond its similarity: shares of the area by the longer of the two
    stretches, and the rms of the logarithms of the area's change.
    """
    from o3dls.geometry.differential import stretches

    rest = run.case.prior.transformed(deform.T_map_prior)
    if len(rest.vertices) != len(deform.surface.vertices):
        return {}
    longer = stretches(rest.vertices, deform.surface.vertices, rest.faces)
    share = rest.face_areas / rest.area
    change = np.log(np.maximum(deform.surface.face_areas, 1e-9) / np.maximum(rest.face_areas, 1e-9))
    found = {f"stretch_beyond_{x:g}": float(share @ (longer > x)) for x in STRETCHES}
    found["stretch_log_rms"] = float(np.sqrt(share @ np.log(np.maximum(longer, 1.0)) ** 2))
    return found | {"area_log_rms": float(np.sqrt(share @ np.clip(change, -3.0, 3.0) ** 2))}


def _measure_gap(a: Surface, b: Surface) -> float:
    """Mean distance between two surfaces, both ways."""
    there, back = distances(sample(a, SAMPLES), b), distances(sample(b, SAMPLES), a)
    return float(0.5 * (there.mean() + back.mean()))


def left_out_statistics(estimate: Estimate) -> Statistics:
    """Per size of block: mean size of the residuals (`left_8_mm`), their rms over the deviation that is
    predicted, noise included (`left_8_z`), Mahalanobis square per row (`left_8_chi`), and the worst block's
    mean (`left_8_worst_mm`).
    """
    fit = estimate.fit
    if fit is None:
        return {}
    rows = len(fit.motion.field.solved.alpha) - 3 * len(fit.problem.marks)
    inverse = _invert_factor(fit.motion.field.solved.factor)
    believed = _select_believed(fit, inverse, rows)
    at = fit.motion.field.observed.at[:rows]
    found: Statistics = {"left_rows": rows}
    for size in BLOCKS:
        count = max(1, len(believed) // size)
        chosen = [believed[rows] for rows in blocks(at[believed], np.arange(len(believed)), count)]
        found |= predict_blocks(f"left_{size}", inverse, fit.motion.field.solved.alpha, chosen)
    return found


def _invert_factor(factor: Array) -> Array:
    from scipy.linalg import solve_triangular

    half = solve_triangular(np.tril(factor), np.eye(len(factor)), lower=True)
    return np.asarray(half.T @ half)


def _select_believed(fit: Any, inverse: Array, rows: int) -> Ints:
    """Rows of points that are believed: whose left-out variance is not that of a point without weight."""
    alone = 1.0 / np.sqrt(np.diag(inverse)[:rows])
    return np.flatnonzero(alone < max(BELIEVED * fit.sigma, 2.0 * float(np.median(alone))))


def predict_blocks(name: str, inverse: Array, alpha: Array, chosen: list[Ints]) -> Statistics:
    residuals, standard, chi = [], [], []
    for block in chosen:
        covariance = np.linalg.inv(inverse[np.ix_(block, block)])
        residual = covariance @ alpha[block]
        residuals.append(residual)
        standard.append(residual / np.sqrt(np.diag(covariance)))
        chi.append(float(alpha[block] @ residual) / len(block))
    every = np.abs(np.concatenate(residuals))
    worst = max(float(np.abs(one).mean()) for one in residuals)
    z = np.concatenate(standard)
    return {
        f"{name}_mm": float(every.mean()),
        f"{name}_worst_mm": worst,
        f"{name}_z": float(np.sqrt((z**2).mean())),
        f"{name}_z_q95": float(np.percentile(np.abs(z), 95)),
        f"{name}_chi": float(np.mean(chi)),
        f"{name}_chi_max": float(np.max(chi)),
    }
