"""Wall that no catheter touched: how much of the veins a result has lost, and how far it lies from the truth
where the map was and where it was not; as records of a case, and as one table of groups.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from o3dls.arrays import Array
from o3dls.case import Case
from o3dls.evaluation.distances import SAMPLES, distances, sample
from o3dls.geometry.surface import Surface

Record = dict[str, Any]
# fields of a true surface, as data_synth.unvisited writes them: how far beyond the body, number of the vein
DEPTH, VEIN = "depth_mm", "tube"
DEEP = 25.0  # mm beyond the body: of vein wall up to there it is counted what is lost
LOST = 6.0  # mm from the result: wall farther from it is lost
MOST_LOST, FARTHER = 0.03, 1.05  # share lost beyond T, and times T's distance: cases above them are counted
DISTANCES = ("t2s", "s2t", "t2s_mapped", "s2t_mapped", "t2s_unmapped", "s2t_unmapped")
METHODS = ("icp", "deform", "topology", "level_set")


def vein_scores(case: Case, surface: Surface) -> dict[str, float]:
    """`vein_lost`: share of true vein wall up to 25 mm deep that is more than 6 mm from a surface; distances
    from truth to surface and back, of mapped and of unmapped wall; empty where the truth does not say what
    is vein and what was mapped.
    """
    truth = case.truth
    if truth is None or truth.surface is None or not {DEPTH, VEIN} <= truth.surface.fields.keys():
        return {}
    found = {"vein_lost": _lost(truth.surface, surface)}
    if truth.held_out is None or truth.unseen is None:
        return found
    there, at = distances(truth.held_out, surface), sample(surface)
    back, of = distances(at, truth.surface), truth.unseen[cKDTree(truth.held_out).query(at)[1]]
    for name, unseen in (("mapped", False), ("unmapped", True)):
        for way, gap, side in (("t2s", there, truth.unseen), ("s2t", back, of)):
            if (side == unseen).any():
                found[f"{way}_{name}"] = float(gap[side == unseen].mean())
    return found


def _lost(truth: Surface, surface: Surface) -> float:
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
    for group, own in _groups(records).items():
        rows += [_row(group, method, own) for method in METHODS if any(r["method"] == method for r in own)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def _groups(records: list[Record]) -> dict[str, list[Record]]:
    """Records by group, by what groups have in common (kind of visit, spread), and all together."""
    found: dict[str, list[Record]] = {}
    for record in records:
        for name in dict.fromkeys((record["group"], *_wider(record["group"]))):
            found.setdefault(name, []).append(record)
    return dict(sorted(found.items()))


def _wider(group: str) -> list[str]:
    """`unvisited_half_350_even` belongs to `unvisited_half_*_even`, `unvisited_*_even` and `unvisited_*`."""
    stem, *rest = group.rsplit("_", 2)
    kind = "unvisited" if stem.startswith("unvisited_") else stem
    return [f"{stem}_*_{rest[-1]}", f"{kind}_*_{rest[-1]}", f"{kind}_*"] if len(rest) == 2 else []


def _row(group: str, method: str, records: list[Record]) -> list[str]:
    by = {name: {r["case"]: r for r in records if r["method"] == name} for name in METHODS}
    own, cases = by[method], list(by[method])
    lost = _beyond(own, by["deform"])
    over = [own[c]["t2s"] / by["deform"][c]["t2s"] > FARTHER for c in cases if c in by["deform"]]
    cells = [group, method, str(len(cases))]
    cells += [f"{100 * lost.mean():.1f} ({100 * lost.max():.1f})", str(int((lost > MOST_LOST).sum()))]
    return [*cells, str(sum(over)), *(_distance(own, by["deform"], by["icp"], key) for key in DISTANCES)]


def _beyond(own: Mapping[str, Record], other: Mapping[str, Record]) -> Array:
    """Share of vein wall that is lost beyond what T lost in the same case."""
    return np.array(
        [r["vein_lost"] - other[c]["vein_lost"] if c in other else np.nan for c, r in own.items()]
    )


def _distance(own: Mapping[str, Record], T: Mapping[str, Record], icp: Mapping[str, Record], key: str) -> str:
    """Mean, times T's mean (the worst case), times the mean of icp."""
    cases = [c for c in own if c in T and c in icp and all(key in side[c] for side in (own, T, icp))]
    if not cases:
        return ""
    a, b, c = (np.array([side[case][key] for case in cases]) for side in (own, T, icp))
    return f"{a.mean():.3f} {a.mean() / b.mean():.2f} ({(a / b).max():.2f}) {a.mean() / c.mean():.2f}"
