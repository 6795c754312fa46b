"""Several finished runs side by side on the screen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..errors import escaped
from .run import Run
from .tables import score_table


def comparison(runs: Mapping[str, Run]) -> str:
    """Return the mean distances of every estimate of several runs, by the runs' names; nothing is averaged,
    and each unit has a table of its own.
    """
    units = dict.fromkeys(run.unit for run in runs.values())
    return "\n".join(
        _table_in_unit(unit, {k: run for k, run in runs.items() if run.unit == unit}) for unit in units
    )


def _table_in_unit(unit: str, runs: Mapping[str, Run]) -> str:
    lines = [
        replace(line, label=escaped(f"{label} {run.case.name} {line.label}"))
        for label, run in runs.items()
        for line in run.score_lines
    ]
    return f"run, case, estimate: mean distances in {unit}\n{score_table(lines)}"
