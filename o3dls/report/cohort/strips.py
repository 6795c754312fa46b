"""The strip plot: one mark per case above the name of each estimate, with lines between the marks of a
case.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...arrays import Array
from ..drawing.charts import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Axis, axis_over
from ..markup import Html, signed, tag
from .cases import CLOSER, FARTHER, NEITHER, Block, CaseOfRuns, outcome, sign_of
from .links import link_report

MARGIN = 0.5  # of a column's width, left and right of the marks
LETTER = 13.0  # pixels of the drawing that a letter takes on a narrow screen
BESIDE = 9.0  # pixels from a mark to its sign
LINES = {CLOSER: "better", FARTHER: "worse", NEITHER: "neither"}  # classes of charts.css
SHORT = 0.18  # of a column's width: half the line of the mean


def strip_plot(block: Block, styles: Mapping[str, int], values: str, out: Path) -> Html:
    """Draw the mean distances of all cases, a mark per case above the name of each estimate.

    styles: the colour of each estimate, as in its report; values: the id of the table of its marks; out: the
    page, from which marks lead to the reports.
    """
    means = [np.array([case.mean(name) for case in block.cases]) for name in block.estimates]
    runs = [np.array(case.means(name)) for case in block.cases for name in block.estimates]
    y = axis_over(f"mean distance, {block.unit}", runs)
    across = [_column_place(k, len(block.estimates)) for k in range(len(block.estimates))]
    columns = list(zip(block.estimates, across, strict=True))
    said = (
        f"Mean distance by case, {block.unit}: one mark per case, lines between the estimates of one case, "
        "a bar at the mean where all cases have the estimate. Lines end in ▼ where the last is closer than "
        "the first, dashed in ▲ where it is farther, dotted in = where there is no significant difference"
    )
    more = ", an upright line from the smallest to the largest of several runs"
    several = any(len(found) > 1 for found in runs)
    said += f"{more if several else ''}. The values are in the table below; a mark leads to its report."
    drawing = tag(
        "svg",
        *_draw_frame(y, columns),
        *(line for case in block.cases if (line := _draw_case_line(case, columns, y, block.unit))),
        *(
            _draw_mean(found, x, y, len(across))
            for found, x in zip(means, across, strict=True)
            if np.isfinite(found).all()  # means over different cases do not compare
        ),
        *(
            _link_mark(_draw_mark(case, name, x, styles[name], y), case, name, out)
            for case in block.cases
            for name, x in columns
            if case.means(name)
        ),
        viewBox=f"0 0 {WIDTH} {HEIGHT}",
        class_="chart strips",
        role="group",
        aria_label=said,
        aria_details=values,
    )
    return tag("figure", drawing, tag("p", said, class_="soft"), class_="plot")


def _column_width(count: int) -> float:
    return (WIDTH - LEFT - RIGHT) / (count - 1 + 2 * MARGIN)


def _column_place(k: int, count: int) -> float:
    return LEFT + (k + MARGIN) * _column_width(count)


def _row_place(value: float, y: Axis) -> float:
    return HEIGHT - BOTTOM - float(y.share(np.array(value))) * (HEIGHT - TOP - BOTTOM)


def _draw_frame(y: Axis, columns: list[tuple[str, float]]) -> list[Html]:
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM
    most = max(3, int(_column_width(len(columns)) / LETTER))
    ticks = [(_row_place(tick, y), f"{tick:g}") for tick in y.ticks()]
    return [
        *(tag("path", d=f"M{LEFT} {at:.1f}H{right}", class_="grid") for at, _ in ticks),
        tag("path", d=f"M{LEFT} {TOP}V{bottom}H{right}", class_="axis"),
        *(tag("text", text, x=LEFT - 6, y=f"{at + 4:.1f}", text_anchor="end") for at, text in ticks),
        *(
            tag(
                "text",
                tag("title", name),
                _shorten_name(name, most),
                x=f"{x:.1f}",
                y=bottom + 22,
                text_anchor="middle",
            )
            for name, x in columns
        ),
    ]


def _shorten_name(name: str, most: int) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}…"


def _draw_case_line(case: CaseOfRuns, columns: list[tuple[str, float]], y: Axis, unit: str) -> Html | None:
    """Draw a line from estimate to estimate of one case, with the sign of the difference between the first
    and the last.
    """
    values = [(name, x, case.mean(name)) for name, x in columns if case.means(name)]
    if len(values) < 2:
        return None
    steps = "L".join(f"{x:.1f} {_row_place(value, y):.1f}" for _, x, value in values)
    first, (last, end, height) = values[0], values[-1]
    pair = (first[0], last)
    found = case.difference(pair)
    sign = sign_of(found, pair) if found else NEITHER
    said = f"{case.name}: {outcome(found, pair)}" if found else f"{case.name}: not the same points"
    return tag(
        "g",
        tag("title", f"{said} ({signed(height - first[2])} {unit})"),
        tag("path", d=f"M{steps}", class_=f"case {LINES[sign]}"),
        tag("text", sign, x=f"{end + BESIDE:.1f}", y=f"{_row_place(height, y) - 7:.1f}", class_="sign"),
    )


def _draw_mean(values: Array, x: float, y: Axis, count: int) -> Html:
    at, half = _row_place(float(values.mean()), y), SHORT * _column_width(count)
    return tag("path", d=f"M{x - half:.1f} {at:.1f}H{x + half:.1f}", class_="mean")


def _link_mark(mark: Html, case: CaseOfRuns, estimate: str, out: Path) -> Html:
    """Make a mark lead to the report of the case's worst run that has one; Tab goes to it on the marks of the
    result alone.
    """
    target = next(filter(None, (link_report(run, out) for run in case.runs)), None)
    if target is None:
        return mark
    leads = f"{case.name}, {estimate}: open the report"
    last = estimate == case.runs[0].last
    return tag("a", mark, href=target, aria_label=leads, tabindex=None if last else "-1")


def _draw_mark(case: CaseOfRuns, name: str, x: float, style: int, y: Axis) -> Html:
    """Draw the mean of one case, and a line from the smallest to the largest of its runs where there are
    several.
    """
    values = case.means(name)
    mean = case.mean(name)
    low, high = _row_place(min(values), y), _row_place(max(values), y)
    return tag(
        "g",
        tag("title", f"{case.name}, {name}: {mean:.2f}"),
        tag("path", d=f"M{x:.1f} {low:.1f}V{high:.1f}", class_=f"series s{style}")
        if len(values) > 1
        else None,
        tag("circle", cx=f"{x:.1f}", cy=f"{_row_place(mean, y):.1f}", r="5", class_=f"f{style} dot"),
    )
