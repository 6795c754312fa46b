"""Records of `accuracy` as tables: one per group, methods below each other, and what is asked of the joint
estimate beside it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from o3dls.arrays import Array

Record = dict[str, Any]
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


def tables(records: list[Record]) -> str:
    groups = dict.fromkeys(record["group"] for record in records)
    return "\n\n".join(_table(group, [r for r in records if r["group"] == group]) for group in groups)


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


def _table(group: str, records: list[Record]) -> str:
    present = dict.fromkeys(record["method"] for record in records)
    methods = [*(name for name in OURS if name in present), *(name for name in present if name not in OURS)]
    columns = [c for c in COLUMNS if any(c in r and np.isfinite(r[c]) for r in records)]
    cases = len({record["case"] for record in records})
    rows = [[f"{group} ({cases})", *columns, "sigma/true", "in 95 %", "prior only", "rank/ideal", "valid"]]
    for method in methods:
        own = [r for r in records if r["method"] == method]
        rows.append([method, *(_spread(_values(own, c)) for c in columns), *_quality(own)])
    if group in ASKED:
        rows.append(
            [
                "asked of level_set",
                *(f"{ASKED[group][c]:.2f}" if c in ASKED[group] else "" for c in columns),
                *[""] * 5,
            ]
        )
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
    return "\n".join([*lines, *_comparisons(records)])


def _values(records: list[Record], key: str) -> Array:
    values = np.array([r[key] for r in records if key in r], dtype=np.float64)
    return values[np.isfinite(values)]


def _spread(values: Array) -> str:
    if len(values) == 0:
        return ""
    if len(values) == 1:
        return f"{values[0]:.3f}"
    return f"{values.mean():.3f}±{values.std(ddof=1) / np.sqrt(len(values)):.3f} ({values.max():.2f})"


def _quality(records: list[Record]) -> list[str]:
    ratio, cover, valid = (_values(records, key) for key in ("sigma_ratio", "cover95", "valid"))
    rank, ideal = _values(records, "rank"), _values(records, "rank_ideal")
    return [
        f"{ratio.mean():.3f}" if len(ratio) else "",
        f"{100 * cover.mean():.1f}" if len(cover) else "",
        _of_prior_only(records),
        f"{rank.mean():.2f}/{ideal.mean():.2f}" if len(rank) else "",
        f"{valid.sum():.0f} of {len(valid)}" if len(valid) else "",
    ]


def _of_prior_only(records: list[Record]) -> str:
    """Share (%) of the wall far from all points, of all cases together, that is within its 95 % band."""
    far, within = _values(records, "prior_only"), _values(records, "prior_only_within")
    return f"{100 * within.sum() / far.sum():.1f}" if far.sum() > 0.0 else ""


def _comparisons(records: list[Record]) -> list[str]:
    """What the joint estimate is worth against its parts and the best peer, case by case."""
    key = "held_out" if any("held_out" in r for r in records) else "ssd"
    by = {
        name: {r["case"]: r for r in records if r["method"] == name}
        for name in dict.fromkeys(r["method"] for r in records)
    }
    if "level_set" not in by:
        return []
    pairs = [("icp", key), *(("deform", k) for k in dict.fromkeys((key, "ssd")))]
    said = [_against(by["level_set"], by[name], name, k) for name, k in pairs if name in by]
    if "icp" in by and any("unseen" in r for r in records):
        said.append(_against(by["level_set"], by["icp"], "icp", "unseen"))
    measures = [
        k for k in dict.fromkeys((key, "ssd", "ssd_seen", "ssd_unseen")) if any(k in r for r in records)
    ]
    said += [line for measure in measures for line in _best_peer(by, measure)]
    return said


def _best_peer(by: dict[str, dict[str, Record]], key: str) -> list[str]:
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


def _against(ours: dict[str, Record], theirs: dict[str, Record], name: str, key: str) -> str:
    both = [case for case in ours if case in theirs and key in ours[case]]
    a, b = (np.array([side[case][key] for case in both]) for side in (ours, theirs))
    worse, better = int((a - b > TOLERATED).sum()), int((b - a > TOLERATED).sum())
    return (
        f"  {key}: level_set - {name} = {_signed(a - b)}; by more than {TOLERATED} worse in {worse}, "
        f"better in {better} of {len(both)}; "
        f"largest ratio {float((a / b).max()):.3f}"
    )


def _signed(difference: Array) -> str:
    if len(difference) == 1:
        return f"{difference[0]:+.3f}"
    return (
        f"{difference.mean():+.3f}±{difference.std(ddof=1) / np.sqrt(len(difference)):.3f} (worst "
        f"{difference.max():+.3f})"
    )
