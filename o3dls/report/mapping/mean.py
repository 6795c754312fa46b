"""What `o3dls cohort --mean` computes, prints and writes: the mean of a value over the hearts of a cohort."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...errors import InputError, did_you_mean
from ...evaluation.electrical import ELECTRICAL, measured_values
from ...evaluation.interpolation import REACH, to_surface
from ...evaluation.projection import project
from ...evaluation.segments.division import VALVE
from ...evaluation.segments.mean_map import HeartMap, SegmentMean, average_maps, average_segments
from ...geometry.surface import Surface
from ...io.surfaces import write_surface
from ..subject import read_subject
from .row_table import lay_out_rows, record_rows
from .segments import Divided, divide_run, divide_source

OWN_ZERO = "lat"  # times are counted from a moment that each map chooses
COLUMNS = ("segment", "name", "hearts", "mean", "low", "high", "spread")
NOTICE = (
    "low and high: 95 % of the mean over hearts such as these. spread: standard",
    "deviation between hearts, which holds the errors of their maps too. Research use",
    "only; not a measurement for a patient's record.",
)


@dataclass(frozen=True, eq=False)
class Mean:
    """A mean has the column and its unit, names of the hearts, what its segments have, the atrium that it
    lies on with the fields `mean`, `spread`, `hearts` and those of its segments, the frame of that, and a
    sentence for each run that could not be used.
    """

    column: str
    unit: str
    hearts: tuple[str, ...]
    segments: list[SegmentMean]
    surface: Surface
    on: str
    frame: str
    left_out: list[str]


def mean_of(runs: Sequence[Path], column: str, on: Path | None = None) -> Mean:
    """Return the mean of a column of the points over finished runs, each of another heart.

    on: a run or a mesh of a left atrium on which to lay it; by default that of the runs whose area is in the
    middle, of those with most sheets. Raises InputError where the column cannot be averaged, or fewer than
    two runs have it.
    """
    if column not in ELECTRICAL:
        raise InputError(f"no column '{column}'{did_you_mean(column, list(ELECTRICAL))}")
    if column == OWN_ZERO:
        raise InputError(
            f"column '{column}': each map counts times from a moment of its own: must be another column"
        )
    found, left_out = list[tuple[Divided, HeartMap]](), list[str]()
    for folder in runs:
        try:
            found.append(_read_heart(folder, column))
        except InputError as error:
            left_out.append(str(error))
    if len(found) < 2:
        why = "".join(f"; {one}" for one in left_out)
        raise InputError(f"{len(found)} of {len(runs)} runs can be averaged: must be at least two{why}")
    maps = [heart for _, heart in found]
    target = divide_source(on) if on else _choose_middle([divided for divided, _ in found])
    mean = average_maps(maps, target.coordinates)
    kept = {name: target.surface.fields[name] for name in ("segment", "alpha", "beta", "sheet")}
    fields: dict[str, Array] = {f"{column}_mean": mean.mean, f"{column}_spread": mean.spread}
    fields["hearts"] = mean.hearts.astype(np.float64)
    return Mean(
        column,
        ELECTRICAL[column],
        tuple(heart.name for heart in maps),
        average_segments(maps),
        replace(target.surface, fields={**kept, **fields}),
        target.name,
        target.frame,
        left_out,
    )


def _read_heart(folder: Path, column: str) -> tuple[Divided, HeartMap]:
    """Read a run, divide its last surface, and bring the values to it."""
    subject = read_subject([folder])
    measured = measured_values(subject.case.points)
    if column not in measured:
        raise InputError(
            f"{folder}: its points have no column '{column}'; they have {', '.join(measured) or 'none'}"
        )
    divided = divide_run(subject, samples=0)
    segment = divided.surface.fields["segment"].astype(int)
    xyz, values = measured[column]
    if not (project(xyz, divided.surface).distance <= REACH).any():
        raise InputError(f"{folder}: no value of '{column}' lies within {REACH:g} mm of its last surface")
    on_wall = np.where(segment == VALVE, np.nan, to_surface(xyz, values, divided.surface))
    return divided, HeartMap(folder.name, divided.coordinates, segment, on_wall)


def _choose_middle(found: Sequence[Divided]) -> Divided:
    """Return the atrium of middle area among those with most sheets."""
    most = max(len(one.coordinates.flat) for one in found)
    whole = sorted(
        (one for one in found if len(one.coordinates.flat) == most),
        key=lambda one: float(one.surface.vertex_areas.sum()),
    )
    return whole[len(whole) // 2]


def write_mean(path: Path, found: Mean) -> list[str]:
    """Write the atrium with the mean as fields, in the format of the suffix, and return what that does not
    keep. Raises InputError where surfaces are not written in that format.
    """
    return write_surface(path, found.surface, space=found.frame, units="mm")


def as_text(found: Mean) -> str:
    """Write the segments as a table of text."""
    lines = lay_out_rows(COLUMNS, found.segments)
    head = f"{found.column} ({found.unit}) of {len(found.hearts)} hearts, on {found.on}"
    return "\n".join([head, *lines, *NOTICE])


def as_json(found: Mean) -> str:
    """Write the segments as JSON, a number that is not known as null."""
    about: dict[str, Any] = {"column": found.column, "unit": found.unit, "hearts": found.hearts}
    about |= {
        "on": found.on,
        "notice": " ".join(NOTICE),
        "left_out": found.left_out,
        "segments": record_rows(found.segments),
    }
    return json.dumps(about, indent=1, ensure_ascii=False)
