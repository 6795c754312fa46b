"""Line charts as inline SVG: they follow the page's colours, print well and need no script."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ..markup import Html, join, table, tag
from ..palette import LIGHT

WIDTH, HEIGHT = 640, 320  # of the drawing; charts.css keeps its letters readable where it shrinks
LEFT, RIGHT, TOP, BOTTOM = 76, 20, 44, 64
HEADROOM = 1.04
MOST_ROWS = 60  # of the table of values
STYLES = len(LIGHT)  # colours s0.. and dashes d0.. of report.css


@dataclass(frozen=True)
class Series:
    """A series is one line: its name in the legend, its style 0..5, and its corners; points that are not
    finite break it.
    """

    name: str
    style: int
    x: Array
    y: Array


@dataclass(frozen=True)
class Axis:
    """An axis has two ends and a label; `log` is for powers of ten."""

    label: str
    low: float
    high: float
    log: bool = False

    def share(self, values: Array) -> Array:
        """Return where values lie between the ends, 0 to 1."""
        if not self.log:
            return np.asarray((values - self.low) / (self.high - self.low))
        return np.asarray(np.log(values / self.low) / math.log(self.high / self.low))

    def ticks(self) -> list[float]:
        """Return round numbers between the ends, about five."""
        if self.log:
            powers = [
                10.0**k for k in range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
            ]
            steps = (1, 2, 5) if self.high < 100 * self.low else (1,)
            return [p * k for p in powers for k in steps if self.low <= p * k <= self.high]
        step = 10.0 ** math.floor(math.log10((self.high - self.low) / 4))
        step = next(step * k for k in (1, 2, 5, 10) if (self.high - self.low) / (step * k) <= 6)
        return [
            step * k
            for k in range(math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9) + 1)
        ]


def line_chart(title: str, series: Sequence[Series], x: Axis, y: Axis, at: Array | None = None) -> Html:
    """Draw a titled chart with its legend and its values as a table. Lines differ in colour and in dashes.

    at: where on the first axis the table reads the lines; None: at their corners.
    """
    parts = [*_draw_grid(x, y), *(_draw_line(one, x, y) for one in series)]
    view = f"0 0 {WIDTH} {HEIGHT}"
    drawing = tag(
        "svg",
        *parts,
        viewBox=view,
        class_="chart",
        role="img",
        aria_label=f"{title}: {', '.join(one.name for one in series)}",
    )
    return tag(
        "figure",
        tag("h3", title),
        drawing,
        legend([(one.name, line_class(one.style)) for one in series]),
        values(title, series, x, y, at),
        class_="plot",
    )


def legend(entries: Sequence[tuple[str, str]]) -> Html:
    """List names with a sample of their line, which its CSS classes give."""
    return tag(
        "p",
        *(tag("span", _draw_sample(classes), name) for name, classes in dict.fromkeys(entries)),
        class_="legend",
    )


def axis_over(label: str, values: Sequence[Array], *, zero: bool = True, log: bool = False) -> Axis:
    """Make an axis that holds all finite values, from zero where asked; it is never empty."""
    known = np.concatenate([np.asarray(v)[np.isfinite(v)] for v in values]) if values else np.zeros(0)
    known = known[known > 0] if log else known
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    low, high = (min(low, 0.0), high * HEADROOM) if zero and not log else (low, high)
    if high <= low:
        low, high = (low / 2, low * 2) if log else (low, low + 1.0)
    return Axis(label, low, high, log)


def _draw_grid(x: Axis, y: Axis) -> list[Html]:
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM
    across, up = (
        [(at, f"{t:g}") for at, t in zip(place(axis, np.array(axis.ticks())), axis.ticks(), strict=True)]
        for place, axis in ((_place_columns, x), (_place_rows, y))
    )
    return [
        *(tag("path", d=f"M{at:.1f} {TOP}V{bottom}", class_="grid") for at, _ in across),
        *(tag("path", d=f"M{LEFT} {at:.1f}H{right}", class_="grid") for at, _ in up),
        tag("path", d=f"M{LEFT} {TOP}V{bottom}H{right}", class_="axis"),
        *(tag("text", text, x=f"{at:.1f}", y=bottom + 24, text_anchor="middle") for at, text in across),
        *(tag("text", text, x=LEFT - 6, y=f"{at + 4:.1f}", text_anchor="end") for at, text in up),
        tag("text", x.label, x=(LEFT + right) / 2, y=HEIGHT - 8, text_anchor="middle"),
        tag("text", y.label, x=4, y=TOP - 24),
    ]


def values(title: str, series: Sequence[Series], x: Axis, y: Axis, at: Array | None = None) -> Html:
    """Tabulate the lines of a chart, folded: a row for each place on the first axis, a dash where a line has
    none.
    """
    places = np.unique(np.concatenate([one.x for one in series])) if at is None else at
    shown = places[np.unique(np.linspace(0, len(places) - 1, MOST_ROWS).astype(int))]
    columns = [_read_heights(one, shown, between=at is not None) for one in series]
    rows = [
        [f"{place:.4g}", *("–" if np.isnan(column[k]) else f"{column[k]:.4g}" for column in columns)]
        for k, place in enumerate(shown)
    ]
    few = f", {len(shown)} of {len(places)}" if len(shown) < len(places) else ""
    numbers = table([x.label, *(one.name for one in series)], rows, f"{title}: {y.label}{few}")
    return tag("details", tag("summary", "Values"), numbers, class_="values")


def _read_heights(one: Series, at: Array, *, between: bool) -> Array:
    """Read the heights of a line at places on the first axis: at corners, or between them too; else NaN."""
    known = np.isfinite(one.y)
    read = np.interp(at, one.x[known], one.y[known], left=np.nan, right=np.nan)
    return read if between else np.where(np.isin(at, one.x[known]), read, np.nan)


def _draw_line(one: Series, x: Axis, y: Axis) -> Html:
    across, up = _place_columns(x, one.x), _place_rows(y, one.y)
    known = np.isfinite(across) & np.isfinite(up)
    starts = known & ~np.r_[False, known[:-1]]
    steps = [
        f"{'M' if start else 'L'}{a:.1f} {b:.1f}"
        for a, b, start in zip(across[known], up[known], starts[known], strict=True)
    ]
    return tag("path", d="".join(steps), class_=f"series {line_class(one.style)}")


def line_class(style: int) -> str:
    """Return CSS classes of a style: colour and dash."""
    return f"s{style % STYLES} d{style % STYLES}"


def _draw_sample(classes: str) -> Html:
    line = tag("path", d="M0 5H32", class_=f"series {classes}")
    return tag("svg", line, viewBox="0 0 32 10", width="32", height="10", aria_hidden="true")


def _place_columns(axis: Axis, values: Array) -> Array:
    return LEFT + axis.share(values) * (WIDTH - LEFT - RIGHT)


def _place_rows(axis: Axis, values: Array) -> Array:
    return HEIGHT - BOTTOM - axis.share(values) * (HEIGHT - TOP - BOTTOM)


def grouped(*parts: Html | None) -> Html:
    """Put charts beside each other where there is room."""
    return tag("div", join(*parts), class_="charts")
