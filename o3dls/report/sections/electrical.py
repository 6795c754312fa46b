"""The electrical map.

What was measured at the points as values on the fused surface, and over what distance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...evaluation.electrical import ELECTRICAL, measured_values
from ...evaluation.interpolation import REACH, WIDTH
from ...geometry.surface import Surface
from ..markup import Child, join, table, tag
from ..section import Section
from ..subject import Subject
from ..surfaces.electrical import with_electrical

LOW_VOLTAGE = 0.5  # mV, bipolar: the usual border of scar


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
    return Section(
        "electrical",
        "Electrical map",
        join(table(head, rows), _low_voltage(surface, subject.last.name), tag("p", said, class_="soft")),
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


def _low_voltage(surface: Surface, name: str) -> Child:
    """Say which share of the reached wall is below the usual border of scar."""
    voltage = surface.fields.get("bipolar")
    if voltage is None or not np.isfinite(voltage).any():
        return None
    reached = _area_share(surface, np.isfinite(voltage))
    low = _area_share(surface, voltage < LOW_VOLTAGE)
    return tag(
        "p",
        f"{low / reached:.0%} of the wall with values of the fused surface ({name}) is below "
        f"{LOW_VOLTAGE:g} mV bipolar.",
    )


def _area_share(surface: Surface, marked: NDArray[np.bool_]) -> float:
    """Return the share of the area whose vertices are marked."""
    return float((marked[surface.faces].mean(axis=1) * surface.face_areas).sum() / surface.area)
