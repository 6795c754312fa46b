"""Scores as tables: the rows of scores.csv and the short table for the screen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..errors import InputError

if TYPE_CHECKING:
    from .run import Run

SCREEN = {  # heading: set, key without its unit
    "fitted": ("fitted", "mean"),
    "left out": ("cross_validated", "mean"),
    "ablation": ("ablation", "mean"),
    "held out": ("held_out", "mean"),
    "unseen": ("held_out_unseen", "mean"),
    "landmarks": ("landmarks", "mean"),
    "to truth": ("truth", "assd"),
    "hd95": ("truth", "hd95"),
    "dice": ("truth", "dice"),
}


def score_rows(run: Run) -> list[dict[str, Any]]:
    """One row per estimate and set, with the columns of every set."""
    rows = [
        {"estimate": name, "set": group, **record}
        for name, sets in run.scores.items()
        for group, record in sets.items()
    ]
    columns = dict.fromkeys(key for row in rows for key in row)
    return [{key: row.get(key) for key in columns} for row in rows]


def score_table(run: Run) -> str:
    """Mean distances of every estimate side by side; the sets that the run has not are left out."""
    return (
        f"{run.case.name}: mean distances in "
        f"{run.unit}\n{_table([(name, run, name) for name in run.estimates])}"
    )


def comparison(runs: Mapping[str, Run]) -> str:
    """Mean distances of every estimate of several runs, by the runs' names; nothing is averaged. Raises
    InputError where units differ.
    """
    units = {run.unit for run in runs.values()}
    if len(units) > 1:
        raise InputError(
            f"the runs are in different units ({', '.join(sorted(units))}): their distances cannot stand "
            "in one table"
        )
    rows = [
        (f"{label} {run.case.name} {name}", run, name)
        for label, run in runs.items()
        for name in run.estimates
    ]
    return f"run, case, estimate: mean distances in {units.pop()}\n{_table(rows)}"


def _table(rows: Sequence[tuple[str, Run, str]]) -> str:
    """Aligned lines of (label, run, name of an estimate)."""
    shown = [
        heading
        for heading, (group, _) in SCREEN.items()
        if any(group in run.scores[name] for _, run, name in rows)
    ]
    lines = [["", *shown, "valid"]] + [
        [label, *_cells(run, name, shown), _verdict(run, name)] for label, run, name in rows
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    aligned = [[first.ljust(widths[0]), *map(str.rjust, rest, widths[1:])] for first, *rest in lines]
    return "\n".join("  ".join(line) for line in aligned)


def _cells(run: Run, name: str, shown: list[str]) -> Iterator[str]:
    for heading in shown:
        group, key = SCREEN[heading]
        record = run.scores[name].get(group, {})
        value = record.get(key, record.get(f"{key}_{run.unit}"))
        yield "-" if value is None else f"{value:.3f}" if key == "dice" else f"{value:.2f}"


def _verdict(run: Run, name: str) -> str:
    return "no" if run.faults_of(name) else "yes"
