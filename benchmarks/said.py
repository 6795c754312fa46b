"""What a report's first screen says of each case, against the truth: python -m benchmarks.said RECORDS

    python -m benchmarks.verdict CASES --folds 5 --records said.jsonl
    python -m benchmarks.verdict CASES --records said.jsonl --peers thin-plate poisson
    python -m benchmarks.said said.jsonl

A row has the grade, the error that the headline expects and the true one (mean of both directions, mm), why
the result is bad, the regions that the screen names as not to rely on, and the region of the result that is
farthest from the true wall in the mean. `named`: whether that region is among the named ones. Under the rows:
how many bad results are OK, the AUC of the grade, which results are farther from the truth than ICP's by more
than 0.1 mm, and where the worst 1 % of the wall is; then the table of benchmarks.bands.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.bands import bands_table
from benchmarks.scores import Record
from benchmarks.verdict import GRADES, WORDS, auc, read_records, reasons, true_error

BEHIND = 0.1  # mm farther than ICP, from which on a user should hear of it
NEAR = 1.5  # a factor between two errors that a reader would call alike
HEAD = ("case", "grade", "expected", "true", "bad", "do not rely on", "worst region", "named")


def table(records: Sequence[Record]) -> str:
    """The rows as a table of Markdown, and what they come to; refused cases are named below it."""
    done = [record for record in records if "grade" in record]
    rows = [HEAD, ("---",) * len(HEAD), *map(_describe, done)]
    refused = [record["case"] for record in records if "error" in record]
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([*lines, "", *_sum_up(done), *([f"refused: {', '.join(refused)}"] if refused else [])])


def worst_region(record: Record) -> str | None:
    """The region with the largest true error; None where regions are not known."""
    regions = record["truth"].get("regions") or {}
    return max(regions, key=regions.__getitem__, default=None)


def _describe(record: Record) -> tuple[str, ...]:
    expected, worst = (record.get("headline") or {}).get("all"), worst_region(record)
    doubts = [doubt["name"] for doubt in record["doubts"]]
    return (
        record["case"],
        WORDS[record["grade"]],
        "" if expected is None else f"{expected:.2f}",
        f"{true_error(record):.2f}",
        " ".join(reasons(record)),
        ", ".join(doubts),
        "" if worst is None else f"{worst} {record['truth']['regions'][worst]:.1f}",
        "" if worst is None else "yes" if worst in doubts else "no",
    )


def _compare_mapped(record: Record) -> float | None:
    """The true error of mapped wall over that which the first screen gives."""
    said = (record.get("headline") or {}).get("mapped")
    true = record["truth"]["errors"][record["final"]].get("mapped")
    return None if said is None or true is None else float(true / said)


def _sum_up(records: Sequence[Record]) -> list[str]:
    bad = [record for record in records if reasons(record)]
    good = [record for record in records if not reasons(record)]
    calm = sum(record["grade"] == "good" for record in bad)
    alarmed = sum(record["grade"] != "good" for record in good)
    levels = [[GRADES[record["grade"]] for record in side] for side in (bad, good)]
    known = [record for record in records if worst_region(record) and record["doubts"]]
    named = sum(worst_region(r) in {doubt["name"] for doubt in r["doubts"]} for r in known)
    ratio = [true_error(r) / r["headline"]["all"] for r in records if r.get("headline")]
    found = [
        f"{len(records)} cases, {len(bad)} bad: {calm} of them OK; {alarmed} of {len(good)} good not OK",
        f"AUC of the grade: {auc(*levels):.2f}",
    ]
    if known:
        found.append(f"worst region among those named: {named} of {len(known)} screens that name any")
    if ratio:
        found.append(f"true over expected error: median {np.median(ratio):.2f}, largest {max(ratio):.1f}")
    if mapped := [one for one in map(_compare_mapped, records) if one is not None]:
        near = sum(1 / NEAR <= one <= NEAR for one in mapped)
        found.append(
            f"true over said error of mapped wall: median {np.median(mapped):.2f}, within a factor {NEAR:g} "
            f"in {near} of {len(mapped)}"
        )
    return [*found, *_compare_with_icp(records), *_sum_up_worst(records), *bands_table(records)]


def _compare_with_icp(records: Sequence[Record]) -> list[str]:
    """How many results are behind ICP's, and which of them are OK all the same."""
    judged = [record for record in records if "icp" in record["truth"]["errors"]]
    behind = [r for r in judged if true_error(r) > r["truth"]["errors"]["icp"]["ssd"] + BEHIND]
    silent = [record["case"] for record in behind if record["grade"] == "good"]
    said = f"farther than ICP by more than {BEHIND:g} mm: {len(behind)} of {len(judged)}"
    return [f"{said}, {len(silent)} of them OK{': ' if silent else ''}{', '.join(silent)}"] if judged else []


def _sum_up_worst(records: Sequence[Record]) -> list[str]:
    """How much of the worst wall is hatched or has a large deviation, where the records have it."""
    names = ("worst_hatched", "hatched", "worst_unsure")
    known = [record["truth"].get("bands", {}) for record in records]
    held = [[one[name] for name in names] for one in known if "hatched" in one]
    if not held:
        return []
    worst, all_of_it, unsure = 100.0 * np.mean(held, axis=0)
    return [
        f"of the worst 1 % of the wall {worst:.0f} % is hatched (of all wall {all_of_it:.0f} %) and "
        f"{unsure:.0f} % is in the tenth with the largest deviation"
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("records", type=Path, help="what benchmarks.verdict wrote, a line per case")
    given = parser.parse_args()
    print(table(list(read_records(given.records).values())))


if __name__ == "__main__":
    main()
