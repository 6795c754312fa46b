"""What is certain and what is not: directions of the pose that the points hardly fix, and whether the
posterior tells its own errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...evaluation.next_places import MEAN_OVER_SD
from ...evaluation.statistics import BAND_68, BAND_95
from ..drawing.charts import STYLES, Series, axis_over, grouped, line_chart
from ..expected import DUE, shares_within
from ..markup import Child, Html, join, millimetres, table, tag
from ..section import Section
from ..shape_words import words_of
from ..subject import Subject
from ..surfaces.display import TRUTH

BINS = 8
MOST_DIRECTIONS = 4


def pose_section(subject: Subject) -> Section | None:
    """Tabulate the least certain directions of each pose whose stage has looked at its Hessian."""
    found = {result.name: result.estimate.facts.get("observability") for result in subject.results.values()}
    rows = [
        _direction_row(name, one) for name, all_ in found.items() for one in (all_ or [])[:MOST_DIRECTIONS]
    ]
    if not rows:
        return None
    unit, shape = subject.unit, words_of(subject).shape
    head = [
        "pose",
        "least certain motions",
        f"moves the {shape} by, {unit}",
        f"translation, {unit}",
        "rotation, degrees",
        "scale, %",
    ]
    note = f"One standard deviation of the pose in each direction, given these points; rms over the {shape}."
    return Section("pose", "Pose uncertainty", tag("div", table(head, rows, note), class_="left"))


def _direction_row(name: str, one: Mapping[str, Any]) -> list[Child]:
    shift, turn = (float(np.linalg.norm(one[key])) for key in ("shift", "turn_degrees"))
    return [
        name,
        str(one["meaning"]),
        millimetres(one["sd"]),
        f"{shift:.2f}",
        f"{turn:.2f}",
        f"{100 * abs(one['log_scale']):.2f}",
    ]


def calibration_section(subject: Subject) -> Section | None:
    """Chart the predicted deviation against the error that was really made, at the vertices; None without
    truth.
    """
    surface = subject.surfaces[subject.last.name]
    unit = subject.unit
    sd = surface.fields.get(f"sd_{unit}")
    error = surface.fields.get(f"{TRUTH}_{unit}")
    within = shares_within(subject)
    if sd is None or error is None or within is None or len(sd) < BINS:
        return None
    order = np.array_split(np.argsort(sd), BINS)
    predicted = np.array([sd[rows].mean() for rows in order])
    made = np.array([error[rows].mean() for rows in order])
    x = axis_over(f"predicted standard deviation, {unit}", [predicted])
    chart = line_chart(
        "Mean error by predicted standard deviation",
        [Series(subject.last.name, subject.style(subject.last.name), predicted, made), _ideal_series(x.high)],
        x,
        axis_over(f"mean distance to truth, {unit}", [made, predicted]),
    )
    return Section(
        "calibration", "Is the uncertainty reliable?", join(_describe_shares(within), grouped(chart))
    )


def _ideal_series(high: float) -> Series:
    """Return what a calibrated posterior of normal errors shows, in the last style, which no shown estimate
    has.
    """
    ends = np.array([0.0, high])
    return Series("calibrated", STYLES - 1, ends, MEAN_OVER_SD * ends)


def _describe_shares(within: tuple[float, float]) -> Html:
    text = (
        f"{within[0]:.0%} of the vertices lie within the {DUE[0]:.0%} band ({BAND_68:.2f} predicted standard "
        "deviations) of the truth, "
    )
    return tag("p", f"{text}{within[1]:.0%} within the {DUE[1]:.0%} band ({BAND_95:.2f}).")
