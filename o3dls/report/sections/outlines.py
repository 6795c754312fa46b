"""The pictures of a case in 2D: outlines with their points."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from ...geometry.surface import Surface
from ..drawing.caption import caption, colour_bar
from ..drawing.charts import STYLES, grouped, legend, line_class
from ..drawing.fields import colours_of, point_field
from ..drawing.slices import Frame, Outline, drawing
from ..markup import Html, join, tag
from ..section import Section
from ..subject import Subject

MARGIN = 0.03  # of the extent, around the outlines


def outline_section(subject: Subject) -> Section | None:
    """Draw each shown estimate of a case in 2D with the truth, the prior in its pose, and the points in the
    colours of their distance.
    """
    if subject.case.dimension == 3:
        return None
    everything = np.vstack(
        [surface.vertices for _, _, surface in _list_surfaces(subject)] + [subject.case.points.xyz]
    )
    frame = _make_frame(everything.min(axis=0), everything.max(axis=0), subject.unit)
    pictures = grouped(*(_draw_estimate(subject, name, frame) for name in subject.shown))
    names = [(name, classes) for one in subject.shown for name, classes, _ in named_outlines(subject, one)]
    gaps = point_field(subject)
    shows = tag("p", caption(subject), class_="soft")
    return Section("pictures", "Side by side", join(pictures, legend(names), colour_bar(gaps), shows))


def _draw_estimate(subject: Subject, name: str, frame: Frame) -> Html:
    """Draw one estimate over the truth and the prior, which stands where this estimate's pose moved it."""
    result = subject.results[name]
    outlines = [
        Outline(label, classes, surface.vertices[surface.faces])
        for label, classes, surface in named_outlines(subject, name)
    ]
    points = result.run.points.of("eam")
    colours = _css_colours(
        colours_of(points.columns[f"distance_{result.key}_{subject.unit}"], point_field(subject))
    )
    return drawing(name, outlines, points.xyz, colours, frame)


def named_outlines(subject: Subject, name: str) -> list[tuple[str, str, Surface]]:
    """Return name, CSS classes and surface of prior, truth and one estimate, in the order of drawing."""
    estimate = subject.results[name].estimate
    placed = subject.case.prior.transformed(estimate.T_map_prior)
    truth = [one for one in _list_surfaces(subject) if one[0] == "truth"]
    return [("prior", "prior", placed), *truth, (name, f"s{subject.style(name) % STYLES}", estimate.surface)]


def _list_surfaces(subject: Subject) -> list[tuple[str, str, Surface]]:
    """List name, CSS classes and surface of the truth and the shown estimates, in the order of drawing."""
    truth = subject.case.truth.surface if subject.case.truth else None
    shown = [
        (name, line_class(subject.style(name)), subject.results[name].estimate.surface)
        for name in subject.shown
    ]
    return [("truth", "truth", truth), *shown] if truth is not None else shown


def _make_frame(low: Array, high: Array, unit: str) -> Frame:
    margin = MARGIN * float((high - low).max())
    return Frame(low - margin, high + margin, unit)


def _css_colours(colours: Array) -> list[str]:
    return ["#" + "".join(f"{round(255 * channel):02x}" for channel in colour) for colour in colours]
