"""What `o3dls next` prints: the places as a table of text, or as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from textwrap import fill

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...io.table import read_table
from ..subject import Subject, read_subject
from .advice import Located, advice, located

WIDTH = 80
NOTICE = "What the posterior expects, not what will be found. Research use only; not advice for a procedure."


def next_places(folder: Path, k: int, reachable: Path | None = None, *, as_json: bool = False) -> str:
    """List the places of a finished run where one more point would tell most.

    Raises InputError where the run has no joint posterior, or the mask does not fit its last surface.
    """
    subject = read_subject([folder])
    found = advice(subject, k, _read_mask(reachable, subject) if reachable else None)
    places = located(subject, found)
    if not as_json:
        return _write_text(subject, places, found.ended)
    about = {"estimate": subject.last.name, "units": subject.unit, "frame": subject.case.frame}
    record = about | {"places": [one.record() for one in places], "ended": found.ended, "notice": NOTICE}
    return json.dumps(record, indent=1)


def _read_mask(path: Path, subject: Subject) -> NDArray[np.bool_]:
    """Read which vertices are reachable, from a table with one row each."""
    values = read_table(path, ("reachable",)).numbers("reachable")
    n = len(subject.last.estimate.surface.vertices)
    if len(values) != n:
        raise InputError(
            f"{path}: has {len(values)} rows: the surface of {subject.last.name} has {n} vertices"
        )
    if wrong := set(values.tolist()) - {0.0, 1.0}:
        raise InputError(f"{path}: column 'reachable' has {min(wrong):g}: must be 0 or 1")
    if not values.any():
        raise InputError(f"{path}: column 'reachable' has no 1, so no place can be proposed")
    return values > 0


def _write_text(subject: Subject, places: list[Located], ended: str) -> str:
    """Write lines that a terminal of 80 columns holds."""
    case, unit = subject.case, subject.unit
    title = f"{case.name}: where to map next, {subject.last.name}; {unit}, frame of the map: {case.frame}"
    lines = [title]
    for k, one in enumerate(places, 1):
        where, around, wall, gap, at = (cell.replace("→", "->") for cell in one.cells())
        lines += [
            f"{k}  {where}, at ({at})",
            f"   error around {around} {unit}, of the wall {wall} {unit}; nearest point {gap} {unit}",
        ]
    return "\n".join(
        fill(line, WIDTH, subsequent_indent="   ")
        if line.startswith(" ") or line[:1].isdigit()
        else fill(line, WIDTH)
        for line in [*lines, *([ended] if ended else []), NOTICE]
    )
