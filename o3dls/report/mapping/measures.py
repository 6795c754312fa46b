"""What `o3dls measure` prints and writes: numbers of the last surface of a run with their intervals."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ...arrays import Array, Ints, Mask
from ...errors import InputError, did_you_mean
from ...evaluation.distances import moved
from ...evaluation.electrical import ELECTRICAL
from ...evaluation.measures.intervals import Measure, measure_samples
from ...evaluation.measures.numbers import WHOLE, Parts, named_parts, places_on
from ...evaluation.measures.ways import shortest_ways
from ...evaluation.regions import REGIONS, tubes, valve_of, word
from ...evaluation.segments.division import SEGMENTS, VALVE
from ...geometry.surface import Surface
from ...io.table import write_table
from ...motion.posterior import wall_posterior
from ...parallel import one_blas_thread
from ...quantities import VOLTAGES
from ...runs.folder import check_not_of_a_run
from ..markup import Child, table
from ..section import Section
from ..subject import Subject, read_subject
from .on_wall import POINTS, Field, measure_lesions, measure_line, wall_field
from .segments import divide_run
from .wall_regions import landmarks_in_map, wall_regions

COLUMNS = ("what", "where", "unit", "naive", "mean", "low", "high")
NOTICE = (
    "low and high: 95 % intervals, by samples of the surface. They hold the error of the registration, and "
    "not that of values between the points. Research use only; not a measurement for a patient's record."
)


@dataclass(frozen=True)
class Asked:
    """This is what is asked of a run: how many samples of its surface, and where their random numbers begin;
    which column of the points, by default below its usual thresholds; a field of the wall that it is set
    against, and from which value on that is a scar; a file of lesions; and whether areas are by the report's
    regions or by the segments of the consensus.
    """

    samples: int = 200
    seed: int = 0
    column: str = "bipolar"
    below: Sequence[float] = ()
    against: str | None = None
    scar_from: float = 1.2
    lesions: Path | None = None
    by: Literal["regions", "segments"] = "regions"

    @property
    def thresholds(self) -> tuple[float, ...]:
        return tuple(self.below or VOLTAGES.get(self.column, ()))


def measure_run(folder: Path, asked: Asked = Asked()) -> tuple[Subject, list[Measure]]:
    """Measure the last surface of a finished run: volume, areas by region and below thresholds of a column
    where the map has it, sections of veins, distances of named places and lengths along the wall; the line of
    the column over what the image shows of the wall, where that is known; and distances of lesions.

    Raises InputError where the run is in 2D or in pixels, or has no posterior in space, and where it lacks
    what is asked.
    """
    subject = read_subject([folder])
    return subject, measure_subject(subject, asked)


@one_blas_thread()
def measure_subject(subject: Subject, asked: Asked = Asked()) -> list[Measure]:
    """Measure the last surface of a subject; as `measure_run`."""
    folder = subject.folders[0] if subject.folders else Path(subject.case.name)
    if subject.case.dimension == 2 or subject.unit != "mm":
        raise InputError(
            f"{folder}: is in {subject.case.dimension}D and {subject.unit}: must be in 3D and mm"
        )
    if asked.column not in ELECTRICAL:
        raise InputError(f"no column '{asked.column}'{did_you_mean(asked.column, list(ELECTRICAL))}")
    surface = subject.last.estimate.surface
    values = surface.fields.get(asked.column)
    if values is None and (asked.below or asked.against):
        raise InputError(f"{folder}: its points have no column '{asked.column}' to compare with anything")
    field = wall_field(subject, asked.against)
    samples = subject.last.estimate.samples(asked.samples, asked.seed)
    parts = _find_parts(subject, surface, asked)
    found = measure_samples(samples, parts, values if parts.thresholds else None)
    rng = np.random.default_rng([asked.seed, 1])
    if field and values is not None:
        found += measure_line(subject, samples, (asked.column, parts.thresholds), field, rng)
    if asked.lesions:
        scars = _find_scars(asked, values, field)
        found += measure_lesions(subject, samples, asked.lesions, scars, rng)
    return found


def _find_scars(asked: Asked, values: Array | None, field: Field | None) -> dict[str, tuple[Array, bool]]:
    """Return by name a field that is below 0 in a scar, and whether it goes with the wall."""
    found = dict[str, tuple[Array, bool]]()
    if values is not None and asked.thresholds:
        low = asked.thresholds[0]
        found[f"{asked.column} below {low:g} {ELECTRICAL[asked.column]}"] = values - low, False
    if field:
        found[f"{field[0]} from {asked.scar_from:g} on"] = asked.scar_from - field[1], True
    return found


def _find_parts(subject: Subject, surface: Surface, asked: Asked) -> Parts:
    """Return what is measured on the surface."""
    marks = landmarks_in_map(subject)
    labels, names, wall = _divide_wall(subject, surface, asked)
    places = places_on(surface, _carried_landmarks(subject))
    return Parts(
        regions=named_parts(labels, names, wall),
        tubes={word(REGIONS.index(name)): inside for name, inside in tubes(surface, marks).items()},
        places=places,
        ways=shortest_ways(surface, wall, {name: vertex for name, (vertex, _) in places.items()}),
        thresholds=asked.thresholds,
        unit=ELECTRICAL[asked.column],
        template=subject.case.prior_of == "template",
    )


def _divide_wall(
    subject: Subject, surface: Surface, asked: Asked
) -> tuple[Ints | None, Mapping[int, str], Mask]:
    """Return the label (n,) of each vertex, if there are parts, the names of these, and which vertices (n,)
    are wall and not the mitral valve.
    """
    if asked.by == "segments":
        segment = divide_run(subject, samples=0).surface.fields["segment"].astype(int)
        names = {k: name for k, name in SEGMENTS.items() if k != VALVE}
        return segment, names, segment != VALVE
    names = {k: word(k) for k in range(len(REGIONS))}
    return wall_regions(subject, surface), names, ~valve_of(surface, landmarks_in_map(subject))


def _carried_landmarks(subject: Subject) -> dict[str, Array]:
    """Return the named places of the prior where the last estimate brings them: what is marked in the map has
    an error of its own, which no sample holds.
    """
    named = subject.case.prior_landmarks
    if not named:
        return {}
    return dict(zip(named, moved(subject.last.estimate, np.array(list(named.values()))), strict=True))


def measured_section(subject: Subject) -> Section | None:
    """Tabulate numbers of the whole wall and of its openings with their intervals; None in 2D, in pixels, and
    where the last estimate has no posterior.
    """
    if (
        subject.case.dimension == 2
        or subject.unit != "mm"
        or wall_posterior(subject.last.estimate.motion) is None
    ):
        return None
    found = [one for one in measure_subject(subject) if _is_shown(one)]
    head: list[Child] = ["number", "unit", "surface alone", "mean", "95 % interval"]
    rows: list[list[Child]] = []
    for one in found:
        name = one.quantity.what if one.quantity.where in (WHOLE, POINTS) else ", ".join(one.quantity[:2])
        known = np.isfinite([one.low, one.high]).all()
        interval = f"{_show(one.low)} to {_show(one.high)}" if known else "–"
        rows.append([name, one.quantity.unit, _show(one.naive), _show(one.mean), interval])
    note = (
        f"Of {subject.last.name}. Intervals hold the error of the registration, and that there may be no "
        "wall; not that of values between the points. o3dls measure has regions, distances and lesions too. "
        "Not a measurement for a patient's record."
    )
    return Section("measured", "Numbers with their intervals", table(head, rows, note))


def _is_shown(one: Measure) -> bool:
    """Return whether a number is of the whole wall, of an opening's size, or of the line of the values."""
    return one.quantity.where in (WHOLE, POINTS) or one.quantity.what == "section diameter"


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
    return "-" if np.isnan(value) else f"{value:.1f}" if abs(value) >= 9.995 else f"{value:.2f}"
