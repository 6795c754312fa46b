"""What each stage contributed: a bar for each, and the same numbers as a table."""

from __future__ import annotations

from collections.abc import Sequence

from ..contribution import Step, steps
from ..drawing.charts import grouped
from ..markup import Child, Html, signed, table, tag
from ..section import Section
from ..subject import SETS, Subject

ROW, LEFT, WIDTH = 52, 12, 640  # pixels; a row has room for a name above its bar
BAR = 14


def contribution_section(subject: Subject) -> Section | None:
    """Show the change of the mean distance by each stage on the way to the last estimate."""
    found = steps(subject)
    if not found or subject.headline is None:
        return None
    unit = subject.unit
    rows: list[list[Child]] = [
        [one.stage, f"{one.before:.2f}", f"{one.after:.2f}", signed(one.change)] for one in found
    ]
    head: list[Child] = ["stage", f"before, {unit}", f"after, {unit}", f"change, {unit}"]
    marks = "▼ and a bar to the left: closer; ▲ and a hollow bar: farther"
    caption = f"Mean distance, {SETS[subject.headline]}; {marks}."
    values = table(head, rows, caption)
    return Section(
        "contributions", "What each stage contributed", grouped(_draw_bars(found, unit), tag("div", values))
    )


def _mark_change(change: float) -> str:
    """Return the way of a change as a mark: none of the estimates' colours says better or worse."""
    return "=" if round(change, 2) == 0 else "▼" if change < 0 else "▲"


def _draw_bars(found: Sequence[Step], unit: str) -> Html:
    most = max(abs(one.change) for one in found) or 1.0
    middle = WIDTH / 2
    parts = [tag("path", d=f"M{middle} 0V{ROW * len(found)}", class_="zero")]
    for k, one in enumerate(found):
        length = (middle - LEFT) * abs(one.change) / most
        top = ROW * k + 31
        left = middle - length if one.change < 0 else middle
        style = "gain nearer" if one.change < 0 else "gain"
        parts += [
            tag(
                "text",
                f"{_mark_change(one.change)} {one.stage} {signed(one.change)} {unit}",
                x=LEFT,
                y=ROW * k + 25,
            ),
            tag("rect", x=f"{left:.1f}", y=top, width=f"{length:.1f}", height=BAR, class_=style),
        ]
    label = "Change by stage: " + ", ".join(f"{one.stage} {signed(one.change)} {unit}" for one in found)
    view = f"0 0 {WIDTH} {ROW * len(found)}"
    drawing = tag("svg", *parts, viewBox=view, class_="chart", role="img", aria_label=label)
    return tag("figure", drawing, class_="plot")
