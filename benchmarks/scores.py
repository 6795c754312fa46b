"""What a result is worth: distances to the truth, calibration, validity and vein wall lost, as one flat
record; and records of `accuracy` as tables.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.estimate import Estimate
from o3dls.evaluation.distances import SAMPLES, distances, sample
from o3dls.evaluation.interpolation import REACH
from o3dls.evaluation.statistics import BAND_95
from o3dls.evaluation.validity import validity
from o3dls.geometry.surface import Surface

Scores = dict[str, float]
Record = dict[str, Any]
FLAT_WITHIN = (
    0.9  # cosine to the slices' axis from which a piece of a ventricle's surface belongs to a flat end cap
)
VERTICES = 2000  # vertices that calibration looks at
SEED = 770_143_905
# fields of a true surface, as data_synth.unvisited writes them: how far beyond the body, number of the vein
DEPTH, VEIN = "depth_mm", "tube"
DEEP = 25.0  # mm beyond the body: of vein wall up to there it is counted what is lost
LOST = 6.0  # mm from the result: wall farther from it is lost
MOST_LOST, FARTHER = 0.03, 1.05  # share lost beyond T, and times T's distance: cases above them are counted
DISTANCES = ("t2s", "s2t", "t2s_mapped", "s2t_mapped", "t2s_unmapped", "s2t_unmapped")
VEIN_METHODS = ("icp", "deform", "topology", "level_set")
COLUMNS = (
    "held_out",
    "seen",
    "unseen",
    "ssd",
    "ssd_seen",
    "ssd_unseen",
    "hd95",
    "t2s",
    "s2t",
    "ablation",
    "correspondence",
    "seconds",
)
ASKED: dict[str, dict[str, float]] = {  # at most; of the joint estimate
    "la": {"held_out": 0.65, "unseen": 1.05, "hd95": 2.0},
    "lah": {"held_out": 0.72},
    "jar_03": {"held_out": 0.28},
    "jar_06": {"held_out": 0.49},
    "jar_09": {"held_out": 0.63},
    "jar_12": {"held_out": 0.76},
    "kit_mri_to_eam": {"ablation": 1.0, "t2s": 0.85, "s2t": 1.4},
    "kit_mri_to_eam+noise2mm": {"ablation": 1.9, "t2s": 1.25, "s2t": 1.8},
    "lv_ed_to_es": {"ssd": 0.32},
    "vampy_moving_la": {"ssd": 0.36},
}
OURS = ("start", "global_pose", "icp", "deform", "topology", "level_set")
TOLERATED = 0.05  # mm: by so much a result may be worse than another's


def scores(case: Case, estimate: Estimate) -> Scores:
    """Distances in the case's units; a key is missing where the case cannot say it."""
    return (
        distance_scores(case, estimate)
        | calibration(case, estimate)
        | {"valid": is_valid(case, estimate.surface)}
    )


def distance_scores(case: Case, estimate: Estimate) -> Scores:
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
            found |= _score_by_area(case, surface, gap)
    if truth.correspondence is not None:
        found["correspondence"] = np.linalg.norm(
            _carry_points(case, estimate, truth.correspondence[0]) - truth.correspondence[1], axis=1
        ).mean()
    return {name: float(value) for name, value in found.items()}


def _score_by_area(case: Case, surface: Surface, gap: Array) -> Scores:
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
        both.append(
            distances(at[~_find_cap(at, source, truth)] if case.name.startswith("lv_") else at, target)
        )
    return both[0], both[1]


def _find_cap(at: Array, source: Surface, truth: Surface) -> Array:
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


def calibration(case: Case, estimate: Estimate) -> Scores:
    """sigma over the noise that inliers really have; share of vertices within their 95 % band, share that is
    prior only, and share that is both; rank correlation of the deviation with the error, and what a perfect
    posterior of the same deviations would reach.
    """
    truth = case.truth
    found = Scores()
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
        far = point_distances(case, estimate.surface.vertices[rows]) > REACH
        found["cover95"] = float(within.mean())
        found |= {"prior_only": float(far.mean()), "prior_only_within": float((far & within).mean())}
        found["rank"], found["rank_ideal"] = (
            _correlate_ranks(sd[rows], error),
            _correlate_ranks(sd[rows], ideal),
        )
    return found


def point_distances(case: Case, at: Array) -> Array:
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


def _carry_points(case: Case, estimate: Estimate, at: Array) -> Array:
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


def _correlate_ranks(a: Array, b: Array) -> float:
    from scipy.stats import spearmanr

    return float(spearmanr(a, b).statistic)


def lay_out(rows: list[list[str]]) -> str:
    """Rows of cells as text whose columns begin below each other."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def tables(records: list[Record]) -> str:
    """A table for each group, methods below each other, and what is asked of the joint estimate."""
    groups = dict.fromkeys(record["group"] for record in records)
    return "\n\n".join(_lay_out_group(group, [r for r in records if r["group"] == group]) for group in groups)


def shifts_named(records: list[Record]) -> str:
    """In how many cases of each group a result says that a part of the map is shifted; no map of these
    generators is.
    """
    named: dict[str, dict[str, bool]] = {}
    for record in records:
        cases = named.setdefault(record["group"], {})
        said = "map-shift" in record.get("warnings", ())
        cases[record["case"]] = cases.get(record["case"], False) or said
    lines = [
        f"  {group}: {sum(cases.values())} of {len(cases)}"
        for group, cases in named.items()
        if any(cases.values())
    ]
    return "\n".join(["map shift named, where there is none:", *lines]) if lines else ""


def _lay_out_group(group: str, records: list[Record]) -> str:
    present = dict.fromkeys(record["method"] for record in records)
    methods = [*(name for name in OURS if name in present), *(name for name in present if name not in OURS)]
    columns = [c for c in COLUMNS if any(c in r and np.isfinite(r[c]) for r in records)]
    cases = len({record["case"] for record in records})
    rows = [[f"{group} ({cases})", *columns, "sigma/true", "in 95 %", "prior only", "rank/ideal", "valid"]]
    for method in methods:
        own = [r for r in records if r["method"] == method]
        rows.append([method, *(_show_spread(_collect_values(own, c)) for c in columns), *_show_quality(own)])
    if group in ASKED:
        rows.append(
            [
                "asked of level_set",
                *(f"{ASKED[group][c]:.2f}" if c in ASKED[group] else "" for c in columns),
                *[""] * 5,
            ]
        )
    return "\n".join([lay_out(rows), *_compare_methods(records)])


def _collect_values(records: list[Record], key: str) -> Array:
    values = np.array([r[key] for r in records if key in r], dtype=np.float64)
    return values[np.isfinite(values)]


def _show_spread(values: Array) -> str:
    if len(values) == 0:
        return ""
    if len(values) == 1:
        return f"{values[0]:.3f}"
    return f"{values.mean():.3f}±{values.std(ddof=1) / np.sqrt(len(values)):.3f} ({values.max():.2f})"


def _show_quality(records: list[Record]) -> list[str]:
    ratio, cover, valid = (_collect_values(records, key) for key in ("sigma_ratio", "cover95", "valid"))
    rank, ideal = _collect_values(records, "rank"), _collect_values(records, "rank_ideal")
    return [
        f"{ratio.mean():.3f}" if len(ratio) else "",
        f"{100 * cover.mean():.1f}" if len(cover) else "",
        _show_prior_only(records),
        f"{rank.mean():.2f}/{ideal.mean():.2f}" if len(rank) else "",
        f"{valid.sum():.0f} of {len(valid)}" if len(valid) else "",
    ]


def _show_prior_only(records: list[Record]) -> str:
    """Share (%) of the wall far from all points, of all cases together, that is within its 95 % band."""
    far, within = _collect_values(records, "prior_only"), _collect_values(records, "prior_only_within")
    return f"{100 * within.sum() / far.sum():.1f}" if far.sum() > 0.0 else ""


def _compare_methods(records: list[Record]) -> list[str]:
    """What the joint estimate is worth against its parts and the best peer, case by case."""
    key = "held_out" if any("held_out" in r for r in records) else "ssd"
    by = {
        name: {r["case"]: r for r in records if r["method"] == name}
        for name in dict.fromkeys(r["method"] for r in records)
    }
    if "level_set" not in by:
        return []
    pairs = [("icp", key), *(("deform", k) for k in dict.fromkeys((key, "ssd")))]
    said = [_compare_pairwise(by["level_set"], by[name], name, k) for name, k in pairs if name in by]
    if "icp" in by and any("unseen" in r for r in records):
        said.append(_compare_pairwise(by["level_set"], by["icp"], "icp", "unseen"))
    measures = [
        k for k in dict.fromkeys((key, "ssd", "ssd_seen", "ssd_unseen")) if any(k in r for r in records)
    ]
    said += [line for measure in measures for line in _compare_best_peer(by, measure)]
    return said


def _compare_best_peer(by: dict[str, dict[str, Record]], key: str) -> list[str]:
    """The lowest mean of a peer beside ours on the same cases; one that failed on some is told by their
    number.
    """
    found = []
    for name in by:
        both = [c for c in by["level_set"] if key in by["level_set"][c] and key in by[name].get(c, {})]
        if name not in (*OURS, "bound") and both:
            ours, theirs = (np.mean([by[n][c][key] for c in both]) for n in ("level_set", name))
            found.append((float(theirs), float(ours), name, len(both)))
    return [
        f"  best peer {name}: level_set is at {ours / theirs:.3f} of its {key} ({cases} cases)"
        for theirs, ours, name, cases in sorted(found)[:1]
    ]


def _compare_pairwise(ours: dict[str, Record], theirs: dict[str, Record], name: str, key: str) -> str:
    both = [case for case in ours if case in theirs and key in ours[case]]
    a, b = (np.array([side[case][key] for case in both]) for side in (ours, theirs))
    worse, better = int((a - b > TOLERATED).sum()), int((b - a > TOLERATED).sum())
    return (
        f"  {key}: level_set - {name} = {_show_difference(a - b)}; by more than {TOLERATED} "
        f"worse in {worse}, better in {better} of {len(both)}; "
        f"largest ratio {float((a / b).max()):.3f}"
    )


def _show_difference(difference: Array) -> str:
    if len(difference) == 1:
        return f"{difference[0]:+.3f}"
    return (
        f"{difference.mean():+.3f}±{difference.std(ddof=1) / np.sqrt(len(difference)):.3f} (worst "
        f"{difference.max():+.3f})"
    )


def vein_scores(case: Case, surface: Surface) -> dict[str, float]:
    """`vein_lost`: share of true vein wall up to 25 mm deep that is more than 6 mm from a surface; distances
    from truth to surface and back, of mapped and of unmapped wall; empty where the truth does not say what
    is vein and what was mapped.
    """
    from scipy.spatial import cKDTree

    truth = case.truth
    if truth is None or truth.surface is None or not {DEPTH, VEIN} <= truth.surface.fields.keys():
        return {}
    found = {"vein_lost": _find_lost(truth.surface, surface)}
    if truth.held_out is None or truth.unseen is None:
        return found
    there, at = distances(truth.held_out, surface), sample(surface)
    back, of = distances(at, truth.surface), truth.unseen[cKDTree(truth.held_out).query(at)[1]]
    for name, unseen in (("mapped", False), ("unmapped", True)):
        for way, gap, side in (("t2s", there, truth.unseen), ("s2t", back, of)):
            if (side == unseen).any():
                found[f"{way}_{name}"] = float(gap[side == unseen].mean())
    return found


def _find_lost(truth: Surface, surface: Surface) -> float:
    from scipy.spatial import cKDTree

    at = sample(truth, SAMPLES)
    row = cKDTree(truth.vertices).query(at)[1]
    vein = (truth.fields[VEIN][row] >= 0) & (truth.fields[DEPTH][row] <= DEEP)
    return float((distances(at[vein], surface) > LOST).mean()) if vein.any() else 0.0


def vein_table(records: list[Record]) -> str:
    """A row for each group and method, and for each kind of group together; empty where no record has lost
    anything or could have.
    """
    records = [r for r in records if "vein_lost" in r]
    if not records:
        return ""
    rows = [["vein wall lost beyond T", "method", "cases", "% mean (worst)", ">3 %", "t2s x T (>1.05)"]]
    rows[0] += [f"{name} mean, x T (worst), x icp" for name in DISTANCES]
    for group, own in _group_widely(records).items():
        rows += [
            _compare_with_T(group, method, own)
            for method in VEIN_METHODS
            if any(r["method"] == method for r in own)
        ]
    return lay_out(rows)


def _group_widely(records: list[Record]) -> dict[str, list[Record]]:
    """Records by group, by what groups have in common (kind of visit, spread), and all together."""
    found: dict[str, list[Record]] = {}
    for record in records:
        for name in dict.fromkeys((record["group"], *_name_wider(record["group"]))):
            found.setdefault(name, []).append(record)
    return dict(sorted(found.items()))


def _name_wider(group: str) -> list[str]:
    """`unvisited_half_350_even` belongs to `unvisited_half_*_even`, `unvisited_*_even` and `unvisited_*`."""
    stem, *rest = group.rsplit("_", 2)
    kind = "unvisited" if stem.startswith("unvisited_") else stem
    return [f"{stem}_*_{rest[-1]}", f"{kind}_*_{rest[-1]}", f"{kind}_*"] if len(rest) == 2 else []


def _compare_with_T(group: str, method: str, records: list[Record]) -> list[str]:
    by = {name: {r["case"]: r for r in records if r["method"] == name} for name in VEIN_METHODS}
    own, cases = by[method], list(by[method])
    lost = _find_lost_beyond(own, by["deform"])
    over = [own[c]["t2s"] / by["deform"][c]["t2s"] > FARTHER for c in cases if c in by["deform"]]
    cells = [group, method, str(len(cases))]
    cells += [f"{100 * lost.mean():.1f} ({100 * lost.max():.1f})", str(int((lost > MOST_LOST).sum()))]
    return [
        *cells,
        str(sum(over)),
        *(_compare_distance(own, by["deform"], by["icp"], key) for key in DISTANCES),
    ]


def _find_lost_beyond(own: Mapping[str, Record], other: Mapping[str, Record]) -> Array:
    """Share of vein wall that is lost beyond what T lost in the same case."""
    return np.array(
        [r["vein_lost"] - other[c]["vein_lost"] if c in other else np.nan for c, r in own.items()]
    )


def _compare_distance(
    own: Mapping[str, Record], T: Mapping[str, Record], icp: Mapping[str, Record], key: str
) -> str:
    """Mean, times T's mean (the worst case), times the mean of icp."""
    cases = [c for c in own if c in T and c in icp and all(key in side[c] for side in (own, T, icp))]
    if not cases:
        return ""
    a, b, c = (np.array([side[case][key] for case in cases]) for side in (own, T, icp))
    return f"{a.mean():.3f} {a.mean() / b.mean():.2f} ({(a / b).max():.2f}) {a.mean() / c.mean():.2f}"
