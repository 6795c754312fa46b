"""What a surface can be coloured by: name, unit and colours.

All estimates have one range, so that pictures compare. Lengths have one of few ranges, so that the same
colour is the same length in the reports of most cases.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...arrays import Array
from ...evaluation.electrical import ELECTRICAL
from ...evaluation.regions import REGIONS, word
from ...geometry.cut_wall import CUT
from ...geometry.surface import Surface
from ...quantities import VOLTAGES
from ..mapping.activation import SPEED, TIME, TIME_SD
from ..subject import Subject
from ..surfaces.beliefs import BELIEVED, beliefs
from ..surfaces.display import LEFT_OUT, NEGLIGIBLE, TRUTH
from .colour_maps import LOW_ENDS, colour_table

STEPS = {"lat": 10.0, TIME: 10.0}  # ms between isochrones
MISSING = 0.72  # grey of wall without a value
LEAST = {"mm": 2.0}  # end of a scale: what is smaller matters little
ROUNDING = 1e-9


@dataclass(frozen=True)
class Field:
    """A field is a column of the surfaces with the words and colours it is shown with.

    low and high are the ends of its colours; lines of equal value are a step apart, none where it is 0.
    """

    key: str
    label: str
    unit: str
    colours: str
    low: float = 0.0
    high: float = 1.0
    step: float = 0.0

    @property
    def names(self) -> list[str]:
        """What the whole numbers of a field of regions stand for; none where values are amounts."""
        return [word(k) for k in range(len(REGIONS))] if self.colours == "regions" else []

    @property
    def low_end(self) -> str:
        """The word for the colour of its low end."""
        return LOW_ENDS.get(self.colours, "light")

    def extended(self, values: Array) -> Literal["neither", "min", "max", "both"]:
        """Say beyond which ends of the colours there are values; these are shown in the end's colour."""
        below, above = bool((values < self.low).any()), bool((values > self.high).any())
        return "both" if below and above else "min" if below else "max" if above else "neither"


def known_fields(surfaces: Sequence[Surface], unit: str) -> list[Field]:
    """List the fields that at least one of the surfaces has, the most telling first: how far from what was
    not fitted, then how sure. How far the prior was moved says neither, and comes after them.

    Each has a range that fits all surfaces.
    """
    words = [
        Field(f"{TRUTH}_{unit}", "distance to truth", unit, "sequential"),
        Field(f"{LEFT_OUT}_{unit}", "distance of left-out points", unit, "sequential"),
        Field(f"sd_{unit}", "posterior standard deviation", unit, "deviation"),
        Field(f"distance_to_nearest_point_{unit}", "distance to the nearest point", unit, "sequential"),
        Field(f"displacement_{unit}", "displacement, outward positive", unit, "signed"),
        Field(f"correction_{unit}", "correction, outward positive", unit, "signed"),
    ]
    wave = [
        Field(TIME, "activation time", "ms", "mapping", step=STEPS[TIME]),
        Field(TIME_SD, "sd of the activation time", "ms", "deviation"),
        Field(SPEED, "conduction speed", "m/s", "electrical"),
    ]
    region = Field("region", "region of the wall", "", "regions")
    there = dict.fromkeys(
        key for surface in surfaces for key, values in surface.fields.items() if values.ndim == 1
    )
    named = {field.key for field in [*words, *wave, region]} | {
        "prior_only",
        CUT,
    }  # hatched, whatever the colours
    others = [_other_field(key) for key in there if key not in named]
    return [_fit_range(field, surfaces) for field in [*words, *wave, *others, region] if field.key in there]


def shown_fields(subject: Subject) -> list[Field]:
    """List the fields of the estimates that are shown, the most telling first. Distances of the wall share
    one scale with those of the points, which stand side by side.
    """
    end = point_field(subject).high
    return [
        replace(one, high=end) if _is_distance(one, subject.unit) else one
        for one in known_fields(list(subject.surfaces.values()), subject.unit)
    ]


def _is_distance(field: Field, unit: str) -> bool:
    """Say whether a field is how far something is from the wall, as the points' distances are."""
    return field.key in (f"{TRUTH}_{unit}", f"{LEFT_OUT}_{unit}")


def _other_field(key: str) -> Field:
    colours = "mapping" if key in VOLTAGES or key in STEPS else "electrical"
    return Field(key, key, ELECTRICAL.get(key, ""), colours, step=STEPS.get(key, 0.0))


def _fit_range(field: Field, surfaces: Sequence[Surface]) -> Field:
    if field.key in VOLTAGES:
        low, high = VOLTAGES[field.key]
        return replace(field, low=low, high=high)
    if field.names:
        return replace(field, low=-0.5, high=19.5)  # each number in the middle of its colour
    values = np.concatenate(
        [surface.fields[field.key] for surface in surfaces if field.key in surface.fields]
    )
    if field.colours == "electrical" or field.key in STEPS:
        low, high = robust_range(values, from_zero=False)
    else:
        low, high = length_range(values, field.unit, signed=field.colours == "signed")
    return replace(field, low=low, high=high)


def length_range(values: Array, unit: str, *, signed: bool = False) -> tuple[float, float]:
    """Return the ends of a colour scale of lengths: of 1, 2, 5 and 10 and so on, in mm from 2 on, the first
    that is no less than those of `robust_range`.
    """
    reach = max(robust_range(values, signed=signed)[1], LEAST.get(unit, 0.0))
    power = 10.0 ** math.floor(math.log10(reach))
    end = next(step * power for step in (1.0, 2.0, 5.0, 10.0) if reach <= step * power * (1 + ROUNDING))
    return (-end if signed else 0.0), end


def robust_range(values: Array, *, signed: bool = False, from_zero: bool = True) -> tuple[float, float]:
    """Return the ends of a colour scale that single extreme values do not stretch.

    Symmetric about zero for signed values, always: what has none, or none but rounding, has the colour of 0.
    """
    values = values[np.isfinite(values)]
    low, high = (float(v) for v in np.percentile(values, [3, 97])) if len(values) else (0.0, 0.0)
    if signed:
        reach = max(abs(low), abs(high))
        return (-reach, reach) if reach > NEGLIGIBLE else (-1.0, 1.0)
    low = 0.0 if from_zero else low
    return (low, high) if high > low else (low, low + 1.0)


def point_field(subject: Subject) -> Field:
    """Make the field of the distances from the points to the shown estimates, with one range for all, which
    the wall's distances fit too. Points that were judged outliers do not stretch it: they have a mark.
    """
    gaps = [_believed_distances(subject, name) for name in subject.shown]
    known = known_fields(list(subject.surfaces.values()), subject.unit)
    ends = [one.high for one in known if _is_distance(one, subject.unit)]
    end = max([length_range(np.concatenate(gaps), subject.unit)[1], *ends])
    return Field("points", "distance of the points", subject.unit, "points", 0.0, end)


def _believed_distances(subject: Subject, name: str) -> Array:
    result = subject.results[name]
    belief = beliefs(result.run, result.key)[result.run.points.type != "landmark"]
    return np.asarray(result.point_distances[~(belief < BELIEVED)])


def colours_of(values: Array, field: Field) -> Array:
    """Return the colour (n, 3) of each value; grey where it is missing."""
    known = np.isfinite(values)
    share = np.clip((values - field.low) / (field.high - field.low), 0, 1)
    table = np.vstack([colour_table(field.colours), np.full(3, MISSING)])
    return np.asarray(table[np.where(known, np.round(255 * share), len(table) - 1).astype(np.intp)])
