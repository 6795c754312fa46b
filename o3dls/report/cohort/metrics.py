"""One strip per metric: a dot for each run in the colour and the shape of its grade, which leads to its
report.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..drawing.charts import WIDTH, Axis, axis_over
from ..grading.check import WORDS, Grade
from ..markup import Html, join, signed, tag
from ..subject import SETS
from .cases import Block
from .entries import Entry
from .grades import WORST_FIRST
from .links import link_report

SIDE = 24  # pixels left and right of a strip
NAME, SAID, LOWEST, LINE, FIGURES, HEIGHT = 20, 44, 84, 96, 122, 130  # from above: words, dots, axis
DOT, LANES = 11.0, 4  # pixels from dot to dot, and rows of dots above each other
MOST_LETTERS = 44  # of a run's name and value, as they fit on a telephone
SHAPES: dict[Grade, str] = {  # about the middle of a dot: colour alone says nothing to some
    "bad": "M-5 -5H5V5H-5Z",
    "amber": "M0 -6L6 5H-6Z",
    "good": "M-5 0A5 5 0 1 0 5 0A5 5 0 1 0 -5 0Z",
}


class Metric(NamedTuple):
    """A metric has its name, its unit and the value of each run of a block, NaN where a run has none."""

    name: str
    unit: str
    values: Sequence[float]

    @property
    def title(self) -> str:
        """The name with the unit."""
        return f"{self.name}, {self.unit}"


def metrics_of(block: Block) -> list[Metric]:
    """List the metrics of the results of a block: the mean distance by which they are judged, what they
    gained over the baseline, what else some run has, and the time.
    """
    runs, judged = block.runs, f"mean distance, {SETS[block.group]}"
    names = dict.fromkeys(name for run in runs for name in run.metrics if name != judged)
    found = [
        Metric(judged, block.unit, [float(run.measured[run.last][1].mean()) for run in runs]),
        Metric("result less baseline", block.unit, [_gain_of(run) for run in runs]),
        *(Metric(name, block.unit, [run.metrics.get(name, math.nan) for run in runs]) for name in names),
        Metric("time of the run", "s", [run.seconds for run in runs]),
    ]
    return [one for one in found if np.isfinite(one.values).any()]


def _gain_of(run: Entry) -> float:
    if run.first is None:
        return math.nan
    return float(run.measured[run.last][1].mean() - run.measured[run.first][1].mean())


def metric_strips(block: Block, out: Path) -> Html:
    """Draw a strip for each metric. out: the page, from which dots lead to the reports."""
    grades = [grade for grade in WORST_FIRST if any(run.grade == grade for run in block.runs)]
    keys = (tag("span", _draw_key(grade), WORDS[grade]) for grade in grades)
    said = "Each run is a dot, which opens its report; Tab goes to a strip, arrow keys along it."
    return join(
        tag("p", *keys, said, class_="soft legend"),
        tag("div", *(_draw_strip(one, block.runs, out) for one in metrics_of(block)), class_="charts"),
    )


def _draw_key(grade: Grade) -> Html:
    return tag("svg", _draw_shape(grade), viewBox="-8 -8 16 16", width=16, height=16, aria_hidden="true")


def _draw_shape(grade: Grade) -> Html:
    return tag("path", d=SHAPES.get(grade, SHAPES["good"]), class_=f"dot {grade}")


def _draw_strip(metric: Metric, runs: Sequence[Entry], out: Path) -> Html:
    values = np.array(metric.values)
    order = [int(k) for k in np.argsort(values) if np.isfinite(values[k])]
    axis = _make_axis(metric)
    across = SIDE + axis.share(values) * (WIDTH - 2 * SIDE)
    lanes = _choose_lanes([across[k] for k in order])
    ticks = [(SIDE + float(axis.share(np.array(at))) * (WIDTH - 2 * SIDE), f"{at:g}") for at in axis.ticks()]
    drawing = tag(
        "svg",
        tag("text", metric.title, x=SIDE, y=NAME),
        tag("path", d=f"M{SIDE} {LINE}H{WIDTH - SIDE}", class_="axis"),
        *(tag("path", d=f"M{at:.1f} {LINE}v5", class_="axis") for at, _ in ticks),
        *(tag("text", text, x=f"{at:.1f}", y=FIGURES, text_anchor="middle") for at, text in ticks),
        *(
            _draw_dot(metric, runs[k], values[k], (across[k], LOWEST - DOT * lane), out)
            for k, lane in zip(order, lanes, strict=True)
        ),
        viewBox=f"0 0 {WIDTH} {HEIGHT}",
        class_="chart metric",
        role="group",
        aria_label=f"{metric.title}: {len(order)} runs",
    )
    return tag("figure", drawing, class_="plot")


def _make_axis(metric: Metric) -> Axis:
    """Choose the ends: from zero, but for what has a sign from the smallest to the largest."""
    known = np.array([value for value in metric.values if math.isfinite(value)])
    if known.min() >= 0.0:
        return axis_over(metric.title, [known])
    low, high = min(known.min(), 0.0), max(known.max(), 0.0)
    room = 0.04 * (high - low)
    return Axis(metric.title, low - room, high + room)


def _choose_lanes(across: Sequence[float]) -> list[int]:
    """Choose the row of each dot, from left to right: the lowest in which it lies on no other."""
    ends = [-math.inf] * LANES
    lanes = []
    for at in across:
        free = [lane for lane in range(LANES) if at - ends[lane] >= DOT]
        lanes.append(free[0] if free else int(np.argmin(ends)))
        ends[lanes[-1]] = at
    return lanes


def _draw_dot(metric: Metric, run: Entry, value: float, at: tuple[float, float], out: Path) -> Html:
    """Draw the dot of a run, with its name and value in words that show when one points at it or reaches it
    by key.
    """
    shown = signed(value) if min(metric.values) < 0 else f"{value:.2f}"
    said = f"{shown} {metric.unit}"
    most = MOST_LETTERS - len(said)
    name = run.name if len(run.name) <= most else f"{run.name[: most - 1]}…"
    parts = (
        tag("text", f"{name}: {said}", x=SIDE, y=SAID),
        tag("g", _draw_shape(run.grade), transform=f"translate({at[0]:.1f} {at[1]:.0f})"),
    )
    target = link_report(run, out)
    label = f"{run.name}, {metric.name}: {said}, {WORDS[run.grade]}"
    if target is None:
        return tag("g", *parts, class_="of-run", role="img", tabindex="0", aria_label=label)
    return tag("a", *parts, class_="of-run", href=target, aria_label=f"{label}: open the report")
