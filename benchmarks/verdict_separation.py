"""Which raw statistics tell bad results from good ones: python -m benchmarks.verdict_separation RECORDS

Of every number in the records, and of some ratios of them: its AUC (`-` where bad results have the lower
value), the rank correlation with the true error, and the threshold above (below) which 5 % and 10 % of the
good lie, with the share of the bad that it catches there.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.verdict import read_records
from benchmarks.verdict_table import auc, flat_statistics, rank_correlation, reasons, true_error
from o3dls.arrays import Array

Record = dict[str, Any]
FALSE = (0.05, 0.10)  # of the good: how many false alarms a threshold may give
RATIOS = (  # what means more over something else than alone
    ("resid_final_mean", "resid_icp_mean"),
    ("resid_final_q95", "final_sigma"),
    ("resid_final_q50", "final_sigma"),
    ("left_1_mm", "final_sigma"),
    ("left_8_mm", "final_sigma"),
    ("left_16_mm", "final_sigma"),
    ("left_16_worst_mm", "left_16_mm"),
    ("apart_icp_final", "sd_mean"),
    ("apart_deform_final", "sd_mean"),
    ("moved_rms", "sd_mean"),
    ("marks_final_rms", "deform_landmark_noise"),
    ("ablation_final", "ablation_icp"),
    ("final_area", "start_area"),
    ("deform_area", "start_area"),
    ("far_reach", "gap_mean"),
    ("deform_last_step", "deform_sigma"),
    ("deform_energy", "points"),
    ("deform_misfit", "points"),
    ("deform_complexity", "points"),
)


def statistics_of(record: Record) -> dict[str, float]:
    """The numbers of a record that a user's program could know, and ratios of them."""
    found = flat_statistics(record) | {"points": record["points"]}
    if record.get("headline"):
        found |= {f"expected_{k}": v for k, v in record["headline"].items() if v is not None}
    for a, b in RATIOS:
        if found.get(b) and found.get(a) is not None:
            found[f"{a}/{b}"] = found[a] / found[b]
    return {key: float(value) for key, value in found.items()}


def separation(records: list[Record], most: int = 60, least: float = 0.8) -> str:
    """The statistics in the order of their AUC; those that fewer than `least` of the records have are left
    out.
    """
    every = [statistics_of(record) for record in records]
    bad = np.array([bool(reasons(record)) for record in records])
    errors = np.array([true_error(record) for record in records])
    rows = []
    for name in dict.fromkeys(key for one in every for key in one):
        values = np.array([one.get(name, np.nan) for one in every])
        known = np.isfinite(values)
        if known.mean() >= least and np.ptp(values[known]) > 0.0:
            rows.append(_row(name, values[known], bad[known], errors[known]))
    rows.sort(key=lambda row: -row[0])
    head = f"{'statistic':34s} AUC     rank   " + "   ".join(f"caught at {x:.0%} (beyond)" for x in FALSE)
    return "\n".join([head, *(line for _, line in rows[:most])])


def _row(name: str, values: Array, bad: Array, errors: Array) -> tuple[float, str]:
    found = auc(values[bad == 1], values[bad == 0])
    sign = 1.0 if found >= 0.5 else -1.0
    caught = []
    for share in FALSE:
        limit = float(np.quantile(sign * values[bad == 0], 1.0 - share))
        caught.append(f"{(sign * values[bad == 1] > limit).mean():4.0%} ({sign * limit:.3g})")
    strength = max(found, 1.0 - found)
    rank = rank_correlation(values.tolist(), errors.tolist())
    said = f"{name:34s} {strength:.3f}{'-' if sign < 0 else ' '}  {rank:+.2f}   "
    return strength, said + "         ".join(caught)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("records", type=Path)
    parser.add_argument("--most", type=int, default=60, help="statistics that are shown")
    arguments = parser.parse_args()
    records = [r for r in read_records(arguments.records).values() if "grade" in r]
    print(separation(records, arguments.most))


if __name__ == "__main__":
    main()
