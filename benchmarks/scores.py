"""What a result is worth: distances to the truth, calibration, validity, as one flat record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import SAMPLES, distances, sample
from o3dls.evaluation.interpolation import REACH
from o3dls.evaluation.validity import validity
from o3dls.geometry.surface import Surface

Record = dict[str, float]
BAND_95 = 1.959964  # deviations that hold 95 % of a Gaussian
FLAT_WITHIN = (
    0.9  # cosine to the slices' axis from which a piece of a ventricle's surface belongs to a flat end cap
)
VERTICES = 2000  # vertices that calibration looks at
SEED = 770_143_905


def scores(case: Case, estimate: Estimate) -> Record:
    """Distances in the case's units; a key is missing where the case cannot say it."""
    return (
        distance_scores(case, estimate)
        | calibration(case, estimate)
        | {"valid": is_valid(case, estimate.surface)}
    )


def distance_scores(case: Case, estimate: Estimate) -> Record:
    truth, surface = case.truth, estimate.surface
    assert truth is not None
    assert truth.surface is not None
    there, back = truth_distances(case, surface)
    found = {"t2s": there.mean(), "s2t": back.mean(), "ssd": 0.5 * (there.mean() + back.mean())}
    found["hd95"] = max(np.percentile(there, 95.0), np.percentile(back, 95.0))
    found["fitted"] = distances(case.points.of("eam").xyz, surface).mean()
    if len(case.points.of("ablation")):
        found["ablation"] = distances(case.points.of("ablation").xyz, surface).mean()
    if truth.held_out is not None:
        gap = distances(truth.held_out, surface)
        found["held_out"] = gap.mean()
        if truth.unseen is not None and truth.unseen.any():
            found |= {"seen": gap[~truth.unseen].mean(), "unseen": gap[truth.unseen].mean()}
            found |= _by_area(case, surface, gap)
    if truth.correspondence is not None:
        found["correspondence"] = np.linalg.norm(
            _carried(case, estimate, truth.correspondence[0]) - truth.correspondence[1], axis=1
        ).mean()
    return {name: float(value) for name, value in found.items()}


def _by_area(case: Case, surface: Surface, gap: Array) -> Record:
    """Mean symmetric distance in seen and in unseen areas: of held-out points to the surface, and of samples
    of the surface to the truth, which belong to the area of the held-out point next to them.
    """
    from scipy.spatial import cKDTree

    truth = case.truth
    assert truth is not None
    assert truth.surface is not None
    assert truth.held_out is not None
    assert truth.unseen is not None
    at = sample(surface, SAMPLES)
    back = distances(at, truth.surface)
    hidden = truth.unseen[cKDTree(truth.held_out).query(at)[1]]
    return {
        f"ssd_{name}": float(0.5 * (gap[truth.unseen == side].mean() + back[hidden == side].mean()))
        for name, side in (("seen", False), ("unseen", True))
        if (hidden == side).any()
    }


def truth_distances(case: Case, surface: Surface, samples: int = SAMPLES) -> tuple[Array, Array]:
    """Distances of samples of the truth to the surface and back; a ventricle's flat end caps, which carry no
    points, are left out.
    """
    assert case.truth is not None
    assert case.truth.surface is not None
    truth = case.truth.surface
    both = []
    for source, target in ((truth, surface), (surface, truth)):
        at = sample(source, samples)
        both.append(distances(at[~_on_cap(at, source, truth)] if case.name.startswith("lv_") else at, target))
    return both[0], both[1]


def _on_cap(at: Array, source: Surface, truth: Surface) -> Array:
    """Whether samples lie where the surface is across the slices, whose axis is the commonest normal of the
    truth.
    """
    from o3dls.geometry.closest_point import ClosestPoint

    normals, areas = truth.face_normals, truth.face_areas
    axis = max(
        normals[np.argsort(-areas)[:50]], key=lambda n: float(areas[np.abs(normals @ n) > 0.999].sum())
    )
    face = ClosestPoint(source.vertices, source.faces).query(at)[1]
    return np.asarray(np.abs(source.face_normals[face] @ axis) > FLAT_WITHIN)


def on_wall(case: Case) -> NDArray[np.bool_]:
    """Which of a case's points (n,) are mapping points that truly lie on the wall."""
    inlier = case.points.type == "eam"
    if case.truth is not None and case.truth.outliers is not None:
        inlier[case.truth.outliers] = False
    return inlier


def calibration(case: Case, estimate: Estimate) -> Record:
    """sigma over the noise that inliers really have; share of vertices within their 95 % band, share that is
    prior only, and share that is both; rank correlation of the deviation with the error, and what a perfect
    posterior of the same deviations would reach.
    """
    truth = case.truth
    found = Record()
    assert truth is not None
    assert truth.surface is not None
    if estimate.sigma is not None and truth.held_out is not None:
        noise = np.sqrt((distances(case.points.xyz[on_wall(case)], truth.surface) ** 2).mean())
        found["sigma_ratio"] = float(estimate.sigma / noise)
    sd = estimate.surface.fields.get(f"sd_{case.units}")
    if sd is not None:
        rows = np.linspace(0, len(sd) - 1, min(VERTICES, len(sd))).round().astype(int)
        error = distances(estimate.surface.vertices[rows], truth.surface)
        ideal = np.abs(np.random.default_rng(SEED).normal(size=len(rows)) * sd[rows])
        within = error <= BAND_95 * sd[rows]
        far = _to_points(case, estimate.surface.vertices[rows]) > REACH
        found["cover95"] = float(within.mean())
        found |= {"prior_only": float(far.mean()), "prior_only_within": float((far & within).mean())}
        found["rank"], found["rank_ideal"] = _rank(sd[rows], error), _rank(sd[rows], ideal)
    return found


def _to_points(case: Case, at: Array) -> Array:
    """Distance of places (n, d) to the nearest mapping point, as the field `prior_only` of a run has it."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(case.points.of("eam").xyz).query(at)[0])


def is_valid(case: Case, surface: Surface) -> float:
    """1 where the surface is closed, without self-intersection, and has pieces and handles as the truth
    (where closed) or the prior.
    """
    assert case.truth is not None
    assert case.truth.surface is not None
    found = validity(surface, case.prior)
    like = case.truth.surface if case.truth.surface.watertight else case.prior
    wanted = validity(like, case.prior)
    same = all(found[key] == wanted[key] for key in ("components", "euler"))
    return float(bool(found["watertight"]) and same and found["self_intersections"] == 0)


def _carried(case: Case, estimate: Estimate, at: Array) -> Array:
    """Where points of the prior went: by the motion, or with the surface where it keeps the prior's
    vertices.
    """
    from o3dls.geometry.closest_point import ClosestPoint

    if estimate.motion is not None:
        return estimate.motion(at)
    _, face, _, bary = ClosestPoint(case.prior.vertices, case.prior.faces).query(at)
    if len(estimate.surface.vertices) != len(case.prior.vertices):
        return np.full(at.shape, np.nan)  # a surface of its own says nothing of where the prior went
    return np.asarray(np.einsum("nc,ncd->nd", bary, estimate.surface.vertices[case.prior.faces[face]]))


def _rank(a: Array, b: Array) -> float:
    from scipy.stats import spearmanr

    return float(spearmanr(a, b).statistic)
