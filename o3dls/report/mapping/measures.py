"""What `o3dls measure` prints and writes: numbers of the last surface of a run with their intervals."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError, did_you_mean
from ...evaluation.distances import moved
from ...evaluation.electrical import ELECTRICAL
from ...evaluation.measures.intervals import Measure, measure_samples
from ...evaluation.measures.numbers import Parts, named_parts, places_on
from ...evaluation.measures.ways import shortest_ways
from ...evaluation.regions import REGIONS, tubes, valve_of, word
from ...io.table import write_table
from ...runs.folder import check_not_of_a_run
from ..subject import Subject, read_subject
from .wall_regions import landmarks_in_map, wall_regions

SAMPLES, SEED = 200, 0
THRESHOLDS = (0.5, 1.5)  # mV: of scar and of healthy wall, as bipolar maps are coloured
COLUMNS = ("what", "where", "unit", "naive", "mean", "low", "high")
NOTICE = (
    "low and high: 95 % of the samples of the surface. They hold the error of the registration, and not that "
    "of values between the points. Research use only; not a measurement for a patient's record."
)


def measure_run(
    folder: Path,
    *,
    samples: int = SAMPLES,
    seed: int = SEED,
    column: str = "bipolar",
    below: Sequence[float] = (),
) -> tuple[Subject, list[Measure]]:
    """Measure the last surface of a finished run: volume, areas by region and below thresholds of a column
    where the map has it, sections of veins, distances of named places and lengths along the wall.

    Raises InputError where the run is in 2D or in pixels, or has no posterior in space.
    """
    subject = read_subject([folder])
    if subject.case.dimension == 2 or subject.unit != "mm":
        raise InputError(
            f"{folder}: is in {subject.case.dimension}D and {subject.unit}: must be in 3D and mm"
        )
    if column not in ELECTRICAL:
        raise InputError(f"no column '{column}'{did_you_mean(column, list(ELECTRICAL))}")
    estimate = subject.last.estimate
    surface = estimate.surface
    marks = landmarks_in_map(subject)
    wall = ~valve_of(surface, marks)
    names = {k: word(k) for k in range(len(REGIONS))}
    places = places_on(surface, _carried_landmarks(subject))
    parts = Parts(
        regions=named_parts(wall_regions(subject, surface), names, wall),
        tubes={word(REGIONS.index(name)): inside for name, inside in tubes(surface, marks).items()},
        places=places,
        ways=shortest_ways(surface, wall, {name: vertex for name, (vertex, _) in places.items()}),
        thresholds=tuple(below or (THRESHOLDS if column == "bipolar" else ())),
        unit=ELECTRICAL[column],
    )
    values = surface.fields.get(column) if parts.thresholds else None
    if values is None and below:
        raise InputError(
            f"{folder}: its points have no column '{column}', so there is no area below a threshold"
        )
    return subject, measure_samples(estimate.samples(samples, seed), parts, values)


def _carried_landmarks(subject: Subject) -> dict[str, Array]:
    """Return the named places of the prior where the last estimate brings them: what is marked in the map has
    an error of its own, which no sample holds.
    """
    named = subject.case.prior_landmarks
    if not named:
        return {}
    return dict(zip(named, moved(subject.last.estimate, np.array(list(named.values()))), strict=True))


def as_text(subject: Subject, found: list[Measure]) -> str:
    """Write the measures as a table of text."""
    rows = [list(COLUMNS)]
    rows += [[*one.quantity, *(_show(x) for x in (one.naive, one.mean, one.low, one.high))] for one in found]
    width = [max(len(row[k]) for row in rows) for k in range(len(COLUMNS))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, width, strict=True)).rstrip() for row in rows]
    return "\n".join([f"{subject.case.name}: {subject.last.name}", *lines, NOTICE])


def as_json(subject: Subject, found: list[Measure]) -> str:
    """Write the measures as JSON, a number that is not known as null."""
    records = [
        {name: None if isinstance(x, float) and np.isnan(x) else x for name, x in one.record().items()}
        for one in found
    ]
    about = {"case": subject.case.name, "estimate": subject.last.name, "notice": NOTICE}
    return json.dumps(about | {"measures": records}, indent=1, ensure_ascii=False)


def write_csv(path: Path, found: list[Measure]) -> None:
    """Write the measures as a table of comma-separated values, a row each. Raises InputError where that would
    replace a file that a run is read from.
    """
    check_not_of_a_run(path)
    records = [one.record() for one in found]
    write_table(path, {name: np.array([record[name] for record in records]) for name in COLUMNS})


def _show(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.1f}" if abs(value) >= 10.0 else f"{value:.2f}"
