"""What a picture carries with it: what it shows, from where, when and by what it was made, and a scale of its
colours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import Array
from ..mapping.views import orientation
from ..markup import Html, tag
from ..subject import Subject
from .colour_maps import colour_table
from .fields import Field

STOPS = 9  # of a colour bar; between them the colours change evenly


def made(subject: Subject) -> str:
    """Return the day of the run and the version of o3dls that made it."""
    return f"{subject.date} · o3dls {subject.runs[-1].provenance.versions['o3dls']}"


def caption(subject: Subject, *, behind: bool = False) -> str:
    """Describe a picture in one line: case, view, day and version."""
    return f"{subject.case.name} · view {view_name(subject, behind=behind)} · {made(subject)}"


def view_name(subject: Subject, *, behind: bool = False) -> str:
    """Name the view from the front or from behind; a case in 2D has only one."""
    if subject.case.dimension == 2:
        return "in the plane"
    return list(orientation(subject).views())[behind]


def colour_bar(field: Field, values: Sequence[Array] = ()) -> Html:
    """Draw the colours of a field as SVG, with the two ends, the middle, and name and unit; an end beyond
    which there are values says so.
    """
    table = colour_table(field.colours)
    steps = [round(k * (len(table) - 1) / (STOPS - 1)) for k in range(STOPS)]
    stops = (
        tag(
            "stop",
            offset=f"{k / (STOPS - 1):.3f}",
            stop_color="#" + bytes(round(255 * c) for c in table[at]).hex(),
        )
        for k, at in enumerate(steps)
    )
    name = f"{field.label}, {field.unit}" if field.unit else field.label
    ends = ((field.low, 0, "start"), ((field.low + field.high) / 2, 130, "middle"), (field.high, 260, "end"))
    beyond = field.extended(np.concatenate(values)) if values else "neither"
    signs = ("≤ " if beyond in ("min", "both") else "", "", "≥ " if beyond in ("max", "both") else "")
    numbers = (
        tag("text", f"{sign}{value:.3g}", x=x, y=26, text_anchor=anchor)
        for sign, (value, x, anchor) in zip(signs, ends, strict=True)
    )
    return tag(
        "svg",
        tag("defs", tag("linearGradient", *stops, id=f"bar-{field.key}")),
        tag("rect", width=260, height=12, fill=f"url(#bar-{field.key})"),
        *numbers,
        tag("text", name, x=0, y=42),
        viewBox="0 0 264 48",
        width=264,
        height=48,
        class_="colour-bar",
        role="img",
        aria_label=f"{name}: colours from {field.low:.3g} to {field.high:.3g}",
    )
