"""Several finished runs side by side on the screen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..errors import InputError, escaped
from .run import Run
from .tables import score_table


def comparison(runs: Mapping[str, Run]) -> str:
    """Mean distances of every estimate of several runs, by the runs' names; nothing is averaged.

    Raises InputError where units differ.
    """
    units = {run.unit for run in runs.values()}
    if len(units) > 1:
        raise InputError(
            f"the runs are in different units ({', '.join(sorted(units))}): their distances cannot stand in "
            "one table"
        )
    lines = [
        replace(line, label=escaped(f"{label} {run.case.name} {line.label}"))
        for label, run in runs.items()
        for line in run.score_lines
    ]
    return f"run, case, estimate: mean distances in {units.pop()}\n{score_table(lines)}"
