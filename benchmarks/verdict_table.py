"""The table of benchmarks.verdict: how well grade, checks and warnings tell bad results from good ones.

A result is bad where its true mean error, both directions, is above twice the error that its headline
expects, or above 1.2 times that of the best tuned peer. AUC: how often a bad result has the worse grade of a
bad and a good one, ties half. What was refused has no result, and is counted apart.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from o3dls.arrays import Array

Record = dict[str, Any]
GRADES = {"good": 0, "amber": 1, "bad": 2}
WORDS = {"good": "OK", "amber": "CHECK", "bad": "FAIL"}
OF_HEADLINE, OF_PEERS = 2.0, 1.2


def true_error(record: Record) -> float:
    """Mean error of the final estimate, both directions."""
    return float(record["truth"]["errors"][record["final"]]["ssd"])


def best_peer(record: Record) -> float | None:
    """The error of the peer that came nearest; None where none ran."""
    return min(record.get("peers", {}).values(), default=None)


def reasons(record: Record) -> list[str]:
    """Why a result is bad; empty where it is good."""
    error, peer = true_error(record), best_peer(record)
    expected = (record.get("headline") or {}).get("all")
    found = ["headline"] if expected is not None and error > OF_HEADLINE * expected else []
    return found + ["peer"] * (peer is not None and error > OF_PEERS * peer)


def auc(bad: Sequence[float] | Array, good: Sequence[float] | Array) -> float:
    """Share of pairs in which the bad one has the higher value, ties half; NaN where a side is empty."""
    one, other = np.asarray(bad, dtype=float)[:, None], np.asarray(good, dtype=float)[None]
    return float(((one > other) + 0.5 * (one == other)).mean()) if one.size and other.size else float("nan")


def rank_correlation(a: Sequence[float], b: Sequence[float]) -> float:
    """Spearman's; NaN where one side is all alike, or there are fewer than three."""
    from scipy.stats import rankdata

    ranks = rankdata(a), rankdata(b)
    if len(ranks[0]) < 3 or any(np.ptp(side) == 0 for side in ranks):
        return float("nan")
    return float(np.corrcoef(*ranks)[0, 1])


def table(records: Iterable[Record]) -> str:
    """All tables: by group and over all, by check, by warning."""
    every = list(records)
    done = [record for record in every if "grade" in record]
    refused = [record["case"] for record in every if "error" in record]
    parts = [_by_group(done), _by_check(done), _by_warning(done)]
    if refused:
        parts.append(f"refused ({len(refused)}): " + ", ".join(refused))
    return "\n\n".join(parts)


def _by_group(records: list[Record]) -> str:
    groups = {record["group"]: [r for r in records if r["group"] == record["group"]] for record in records}
    head = ["group", "n", "bad", "OK/CHECK/FAIL of bad", "of good", "AUC", "rank", "true/expected"]
    rows = [[group, *_row(own)] for group, own in groups.items()]
    return _laid_out([head, *rows, ["all", *_row(records)]])


def _row(records: list[Record]) -> list[str]:
    bad, good = _parted(records)
    errors = [true_error(record) for record in records]
    ratios = [e / r["headline"]["all"] for e, r in zip(errors, records, strict=True) if r.get("headline")]
    levels = [[GRADES[record["grade"]] for record in side] for side in (bad, good)]
    return [
        str(len(records)),
        str(len(bad)),
        _grades(bad),
        _grades(good),
        f"{auc(*levels):.2f}",
        f"{rank_correlation([GRADES[r['grade']] for r in records], errors):.2f}",
        f"{np.median(ratios):.2f} ({np.max(ratios):.1f})" if ratios else "",
    ]


def _parted(records: list[Record]) -> tuple[list[Record], list[Record]]:
    """The bad ones and the good ones."""
    return [r for r in records if reasons(r)], [r for r in records if not reasons(r)]


def _grades(records: list[Record]) -> str:
    return "/".join(str(sum(r["grade"] == grade for r in records)) for grade in GRADES)


def _by_check(records: list[Record]) -> str:
    """How often each check was not OK, on bad and on good results."""
    said = {
        f"{check['name']}: {WORDS[check['grade']]}"
        for record in records
        for check in record["checks"]
        if check["grade"] in ("amber", "bad")
    }
    return _counted(
        "check",
        records,
        {
            name: [
                any(f"{c['name']}: {WORDS.get(c['grade'], '')}" == name for c in r["checks"]) for r in records
            ]
            for name in said
        },
    )


def _by_warning(records: list[Record]) -> str:
    codes = {warning["code"] for record in records for warning in record["warnings"]}
    told = {code: [any(w["code"] == code for w in r["warnings"]) for r in records] for code in codes}
    told["(any warning)"] = [bool(record["warnings"]) for record in records]
    return _counted("warning", records, told)


def _counted(name: str, records: list[Record], told: Mapping[str, list[bool]]) -> str:
    """Rows of how often something was said on bad and on good results, the most false alarms first."""
    bad = np.array([bool(reasons(record)) for record in records], dtype=bool)
    found = []
    for what, where in told.items():
        there = np.array(where, dtype=bool)
        on = int((there & bad).sum()), int((there & ~bad).sum())
        found.append((on[1], on[0], what))
    head = [name, f"of {int(bad.sum())} bad", f"of {int((~bad).sum())} good"]
    return _laid_out([head, *([what, str(b), str(g)] for g, b, what in sorted(found, reverse=True))])


def _laid_out(rows: list[list[str]]) -> str:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def write_csv(path: Path, records: Iterable[Record]) -> None:
    """Every case as a row: grade, headline, truth, why it is bad, what was said, and the raw statistics."""
    rows = [_flat(record) for record in records]
    names = dict.fromkeys(key for row in rows for key in row)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(names))
        writer.writeheader()
        writer.writerows(rows)


def _flat(record: Record) -> Record:
    about = {key: record.get(key) for key in ("group", "case", "points", "seconds", "error")}
    if "grade" not in record:
        return about | {"grade": "refused"}
    told = [check for check in record["checks"] if check["grade"] in ("amber", "bad")]
    said = {
        "grade": record["grade"],
        "expected": (record["headline"] or {}).get("all"),
        "true": true_error(record),
        "best_peer": best_peer(record),
        "bad": " ".join(reasons(record)),
        "checks": " ".join(f"{check['name']}={check['grade']}" for check in told),
        "warnings": " ".join(dict.fromkeys(warning["code"] for warning in record["warnings"])),
        "noise_true": record["truth"]["noise"],
    }
    errors = {
        f"true_{name}_{key}": value
        for name, of in record["truth"]["errors"].items()
        for key, value in of.items()
    }
    return about | said | errors | flat_statistics(record)


def flat_statistics(record: Record) -> dict[str, float]:
    """The raw statistics that are numbers."""
    return {key: value for key, value in record.get("stats", {}).items() if isinstance(value, int | float)}
