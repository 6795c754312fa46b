"""What `o3dls activation` prints and writes of what it found."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from textwrap import wrap
from typing import Any

from .activation import Activation, Row
from .row_table import lay_out_rows, record_rows, write_rows

WIDTH = 80
COLUMNS = tuple(one.name for one in fields(Row))
NOTICE = (
    "low and high: 95 %, by noise of times, errors of the registration, and what",
    "lies between the points. A site lies within so many mm of the vertex with the",
    "first or last time. naive: of times averaged on the wall. Narrow slow wall",
    "seems faster than it is: see docs/activation.md. Research use only; not a",
    "measurement for a patient's record.",
)


def as_text(found: Activation) -> str:
    """Write the activation as a table of text, 80 columns wide but for long names."""
    cycle = "" if found.cycle is None else f", cycle length {found.cycle:g} ms"
    lines = lay_out_rows(COLUMNS, found.rows)
    said = [line for one in found.remarks for line in wrap(one, WIDTH)]
    return "\n".join([f"{found.name}: activation{cycle}", *lines, *said, *NOTICE])


def as_json(found: Activation) -> str:
    """Write the activation as JSON, a number that is not known as null."""
    about: dict[str, Any] = {"case": found.name, "cycle_ms": found.cycle, "remarks": found.remarks}
    about |= {"notice": " ".join(NOTICE), "activation": record_rows(found.rows)}
    return json.dumps(about, indent=1, ensure_ascii=False)


def write_activation(out: Path, found: Activation) -> None:
    """Write a folder with the table (activation.csv, activation.json), and the last surface with times and
    velocities as fields (surface.ply, surface.vtp). Raises InputError where the folder exists, or is of a
    run.
    """
    write_rows(out, "activation", found.rows, as_json(found), found.surface, found.frame)
