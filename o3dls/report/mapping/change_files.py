"""What `o3dls change` prints and writes of what it found."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

from .change import Change, Row
from .row_table import lay_out_rows, record_rows, write_rows

COLUMNS = tuple(one.name for one in fields(Row))
NOTICE = (
    "low and high: 95 %, by the errors of both registrations, those of values, and",
    "what lies between the points. A small region may be called changed where nothing",
    "is: docs/change.md says how often. Values after are free of what differs",
    "everywhere. Research use only; not a measurement for a patient's record.",
)
TWO_PRIORS = (
    "The runs have two priors, which stay {apart:.1f} mm rms apart once registered. The",
    "errors of that are in the intervals, those of two segmentations are not; no",
    "displacement is given.",
)


def as_text(found: Change) -> str:
    """Write the change as a table of text, 80 columns wide but for long names."""
    lines = lay_out_rows(COLUMNS, found.rows)
    before, after = found.names
    return "\n".join([f"{before} to {after}: {found.column}", *lines, *_say_notices(found)])


def as_json(found: Change) -> str:
    """Write the change as JSON, a number that is not known as null."""
    about: dict[str, Any] = {"before": found.names[0], "after": found.names[1], "column": found.column}
    about |= {
        "priors_apart_mm": found.apart,
        "notice": " ".join(_say_notices(found)),
        "changes": record_rows(found.rows),
    }
    return json.dumps(about, indent=1, ensure_ascii=False)


def write_change(out: Path, found: Change) -> None:
    """Write a folder with the table (change.csv, change.json), and the prior in the first map with what
    changed as fields (surface.ply, surface.vtp). Raises InputError where the folder exists, or is of a run.
    """
    write_rows(out, "change", found.rows, as_json(found), found.surface, found.frame)


def _say_notices(found: Change) -> list[str]:
    more = [] if found.apart is None else [line.format(apart=found.apart) for line in TWO_PRIORS]
    return [*more, *NOTICE]
