"""Differences that can be believed: the same points, two estimates, an interval from resampled blocks; whole
and by region.
"""

from __future__ import annotations

import math

import numpy as np

from ...evaluation.statistics import ROUNDS, Difference, paired_difference
from ..markup import Child, Html, join, millimetres, signed, table, tag
from ..section import Section
from ..subject import SETS, Result, Subject
from ..verdict import difference

REGION = 20.0  # points nearer than this to a landmark (mm) belong to its region, each to its nearest
FEWEST = 8
SMALLEST = 0.005  # a table with two digits would show a smaller difference as 0


def paired_section(subject: Subject) -> Section | None:
    """Compare the last estimate with all others on the headline set, and with the first shown on all sets."""
    last = subject.last
    sets = [group for group in SETS if len(last.measured(group)[1]) > 1]
    rows = [
        [f"{last.name} − {other.name}", SETS[group], *_difference_cells(found)]
        for group in sets
        for other in subject.results.values()
        if other is not last
        and (group == subject.headline or other is subject.first)
        and (found := difference(other, last, group))
    ]
    if not rows:
        return None
    unit = subject.unit
    head = [
        "difference of distances",
        "points",
        f"mean, {unit}",
        f"95 % interval, {unit}",
        "relative",
        "n",
        "blocks",
    ]
    why = f"Intervals from {ROUNDS} resamplings of spatial blocks, since neighbouring points err together."
    note = f"Below zero: {last.name} is closer. {why}"
    return Section(
        "paired",
        "Paired differences",
        join(table(head, rows), tag("p", note, class_="soft"), _regions_table(subject)),
    )


def _difference_cells(found: Difference) -> list[Child]:
    interval = "too few" if math.isnan(found.low) else f"{signed(found.low)} to {signed(found.high)}"
    mean = tag(
        "span", signed(found.mean), class_="best" if found.clear and abs(found.mean) >= SMALLEST else None
    )
    return [mean, interval, f"{signed(found.percent, 0)} %", found.n, found.blocks]


def _regions_table(subject: Subject) -> Html | None:
    """Tabulate the headline set split by the nearest landmark: veins apart from the body."""
    marks = subject.case.points.of("landmark")
    if subject.headline is None or subject.first is None or len(marks) == 0 or subject.case.units == "px":
        return None
    positions, gaps = subject.last.measured(subject.headline)
    same, before = subject.first.measured(subject.headline, subject.last)
    if same.shape != positions.shape:
        return None
    away = np.linalg.norm(positions[:, None] - marks.xyz[None], axis=2)
    region = np.where(away.min(axis=1) < REGION, away.argmin(axis=1), len(marks))
    names = [f"near {name}" for name in marks.columns["name"].tolist()] + ["elsewhere"]
    rows = [
        [
            names[k],
            *_region_cells(paired_difference(before[region == k], gaps[region == k], positions[region == k])),
        ]
        for k in range(len(names))
        if (region == k).sum() >= FEWEST
    ]
    if not rows:
        return None
    first = subject.first.name
    last = subject.last.name
    unit = subject.unit
    head = [
        f"{SETS[subject.headline]}, by nearest landmark",
        first,
        last,
        f"difference, {unit}",
        f"95 % interval, {unit}",
        "n",
    ]
    caption = f"Mean distance by region; a region holds what is within {REGION:g} {unit} of its landmark."
    return table(head, rows, caption)


def _region_cells(found: Difference) -> list[Child]:
    return [f"{found.first:.2f}", f"{found.second:.2f}", *_difference_cells(found)[:2], found.n]


def landmark_section(subject: Subject) -> Section | None:
    """Tabulate the error at each landmark: after each estimate, and as the landmark fit predicts it from the
    others.
    """
    marks = subject.case.points.of("landmark")
    names = [str(name) for name in marks.columns.get("name", [])]
    if not names or "landmarks" not in subject.last.scores:
        return None
    rows: list[list[Child]] = [
        [result.name, *_landmark_errors(result, subject.unit)] for result in subject.results.values()
    ]
    rows += [[f"{name}, leave-one-out", *errors] for name, errors in _left_out(subject, names)]
    caption = f"Distance, {subject.unit}, from each landmark of the map to its partner on the moved prior."
    return Section("landmarks", "Landmarks", table(["estimate", *names], rows, caption))


def _landmark_errors(result: Result, unit: str) -> list[Child]:
    points = result.run.points.of("landmark")
    return ["–" if np.isnan(v) else f"{v:.2f}" for v in points.columns[f"distance_{result.key}_{unit}"]]


def _left_out(subject: Subject, names: list[str]) -> list[tuple[str, list[Child]]]:
    """Return what the landmark fits say about a landmark that they were not shown."""
    rows: list[tuple[str, list[Child]]] = []
    for result in subject.results.values():
        found = result.estimate.facts.get("landmarks", {})
        errors: list[float | None] = [found.get(name, {}).get("leave_one_out") for name in names]
        if any(error is not None for error in errors):
            cells: list[Child] = [millimetres(error) for error in errors]
            rows.append((result.name, cells))
    return rows
