"""The electrical map: what was measured at the points as values on the fused surface, over what distance; and
the wave that activation times tell of.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Mask
from ...evaluation.electrical import ELECTRICAL, measured_values
from ...evaluation.interpolation import REACH, WIDTH
from ...evaluation.measures.numbers import CM2, Parts, Quantity, measure_surface, named_parts
from ...evaluation.regions import SIDES, openings, word
from ...geometry.surface import Surface
from ...quantities import VOLTAGES
from ..drawing.charts import Axis, Series, axis_over, grouped, line_chart
from ..drawing.fields import known_fields
from ..drawing.pictures import wall_pictures
from ..mapping.activation import SPEED, TIME, TIME_SD, Activation, Row, shown_activation, with_activation
from ..mapping.wall_regions import landmarks_in_map, wall_regions
from ..markup import Child, Html, join, table, tag
from ..section import Section
from ..subject import Subject
from ..surfaces.electrical import with_electrical

BINS, MOST_SHOWN = 24, 99.0  # bins of the histogram, and the percentile of the values where it ends
NO_BREAK = "\N{NO-BREAK SPACE}"
TIMES = ("earliest", "latest", "activation time")
WAVE_HEAD: tuple[Child, ...] = (
    "part of the wall",
    "mapped, cm²",
    *(f"{what}, ms" for what in TIMES),
    "of that with a speed, %",
    "speed, median, m/s",
)
WAVE_NOTE = (
    "Of {name}. In brackets 95 % intervals: they hold noise of times, errors of the registration, and "
    "what lies between the points. A speed is told only where the map shows it. Narrow slow wall seems "
    "faster than it is. Not a measurement for a patient's record."
)


def electrical_section(subject: Subject) -> Section | None:
    """Tabulate what the electrical columns hold, how near the wall is, and how much of it they reach."""
    values = measured_values(subject.case.points)
    if not values or subject.case.dimension == 2:
        return None
    surface = with_electrical(subject.last.estimate.surface, subject.case.points)
    rows = [_column_row(surface, name, *found) for name, found in values.items()]
    head: list[Child] = [
        "measured",
        "unit",
        "points",
        "median",
        "5 % to 95 %",
        "median distance to a measurement, mm",
        "largest distance, mm",
        "wall with values",
    ]
    said = (
        f"Each vertex has the mean of the values measured near it, weighted by a Gaussian of {WIDTH:g} mm; "
        f"farther than {REACH:g} mm from all of them the wall has no value."
    )
    mapped = [name for name in VOLTAGES if name in values and subject.unit == "mm"]
    voltages = [_describe_voltage(subject, surface, name) for name in mapped]
    return Section(
        "electrical",
        "Electrical map",
        join(table(head, rows), *voltages, tag("p", said, class_="soft")),
    )


def _column_row(surface: Surface, name: str, xyz: Array, values: Array) -> list[Child]:
    from scipy.spatial import cKDTree

    known = np.isfinite(surface.fields[name])
    gap = np.asarray(cKDTree(xyz).query(surface.vertices[known])[0])
    low, high = np.percentile(values, [5, 95])
    away: list[Child] = [f"{np.median(gap):.1f}", f"{gap.max():.1f}"] if len(gap) else ["–", "–"]
    share = _area_share(surface, known)
    return [
        name,
        ELECTRICAL[name],
        len(values),
        f"{np.median(values):.2f}",
        f"{low:.2f} to {high:.2f}",
        *away,
        f"{share:.0%}",
    ]


def _describe_voltage(subject: Subject, surface: Surface, name: str) -> Html:
    """Tabulate the area below the thresholds of a voltage by part of the chamber, and draw its histogram."""
    values = surface.fields[name]
    chamber = openings(surface, landmarks_in_map(subject)) < 0
    sides = {k: word(k) for k in range(len(SIDES))}
    parts = named_parts(wall_regions(subject, surface), sides, chamber)
    thresholds, unit = VOLTAGES[name], ELECTRICAL[name]
    found = measure_surface(surface, Parts(parts, thresholds=thresholds, unit=unit), values=values)
    head: list[Child] = ["part of the chamber", "area, cm²"]
    for threshold in thresholds:
        head += [f"below {threshold:g} {unit}, cm²", "of the area with values, %"]
    rows = [_area_row(found, part, [f"below {one:g} {unit}" for one in thresholds]) for part in parts]
    note = f"{name.capitalize()} voltage of {subject.last.name}. Valve, veins and appendage are left out."
    return join(table(head, rows, note), _draw_histogram(surface, values, chamber, f"{name}, {unit}"))


def _area_row(found: dict[Quantity, float], part: str, below: list[str]) -> list[Child]:
    row: list[Child] = [part, f"{found[Quantity('area', part, 'cm²')]:.1f}"]
    for what in below:
        share = found[Quantity(f"share {what}", part, "%")]
        row += [
            f"{found[Quantity(f'area {what}', part, 'cm²')]:.1f}",
            "–" if np.isnan(share) else f"{share:.0f}",
        ]
    return row


def _draw_histogram(surface: Surface, values: Array, chamber: Mask, label: str) -> Html | None:
    """Draw how much of the chamber's wall has which value."""
    known = chamber & np.isfinite(values)
    if not known.any():
        return None
    reach = max(float(np.percentile(values[known], MOST_SHOWN)), 1e-9)
    area, edges = np.histogram(values[known], BINS, (0.0, reach), weights=surface.vertex_areas[known] / CM2)
    one = Series("area", 0, np.repeat(edges, 2)[1:-1], np.repeat(area, 2))
    middles = (edges[1:] + edges[:-1]) / 2
    title = "Area of the wall at a voltage"
    return grouped(line_chart(title, [one], Axis(label, 0.0, reach), axis_over("cm²", [one.y]), middles))


def _area_share(surface: Surface, marked: NDArray[np.bool_]) -> float:
    """Return the share of the area whose vertices are marked."""
    return float((marked[surface.faces].mean(axis=1) * surface.face_areas).sum() / surface.area)


def activation_section(subject: Subject) -> Section | None:
    """Draw times and speeds of the wave, and tabulate them by part of the wall; None where the last estimate
    has no posterior, or too few points have a time.
    """
    found = shown_activation(subject)
    if found is None:
        return None
    surface = with_activation(subject, {subject.last.name: found.surface})[subject.last.name]
    fields = {field.key: field for field in known_fields([surface], subject.unit)}
    drawn = wall_pictures(subject, surface, [fields[key] for key in (TIME, TIME_SD, SPEED)])
    said = (tag("p", one) for one in found.remarks)
    return Section("activation", "Activation", join(*said, drawn, _tabulate_wave(subject.last.name, found)))


def _tabulate_wave(name: str, found: Activation) -> Html:
    by = {(row.where, row.what): row for row in found.rows}
    rows: list[list[Child]] = []
    for where in dict.fromkeys(row.where for row in found.rows):
        mapped = by[where, "area mapped"].value
        told = by[where, "area with a velocity"].value
        rows.append(
            [
                where,
                f"{mapped:.1f}",
                *(_write_row(by.get((where, what)), 0) for what in TIMES),
                f"{100.0 * told / mapped:.0f}" if mapped > 0.0 else "–",
                _write_row(by.get((where, "speed, median")), 2),
            ]
        )
    return table(WAVE_HEAD, rows, WAVE_NOTE.format(name=name))


def _write_row(row: Row | None, digits: int) -> str:
    if row is None or not np.isfinite(row.value):
        return "–"
    interval = f"({row.low:.{digits}f} to {row.high:.{digits}f})".replace(" ", NO_BREAK)
    return f"{row.value:.{digits}f} {interval}"
