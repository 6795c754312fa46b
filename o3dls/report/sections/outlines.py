"""Outlines on paper: cross-sections of surfaces in 3D, and the pictures of a case in 2D."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from ...geometry.surface import Surface
from ..drawing.charts import STYLES, grouped, legend, line_class
from ..drawing.fields import colours_of, point_field
from ..drawing.slices import Frame, Outline, drawing, slice_surface
from ..markup import Html, join, tag
from ..subject import Subject
from .section import Section

BESIDE = 2.0  # mm beside a plane within which points are drawn
MARGIN = 0.03  # of the extent, around the outlines
# and which side of the patient is drawn on the right
PLANES = {
    "sagittal": "front",
    "coronal": "left",
    "axial": "left",
}


def slice_section(subject: Subject) -> Section | None:
    """Contours of the shown estimates and the truth in three planes through the middle of the last."""
    if subject.case.dimension == 2:
        return None
    low, high = (
        pick(axis=0)
        for pick in (subject.last.estimate.surface.vertices.min, subject.last.estimate.surface.vertices.max)
    )
    side_of = " ({} on the right)".format if subject.case.frame != "unknown" else lambda side: ""
    pictures = [
        _slice(
            subject, (f"{name}, {'xyz'[axis]} = {round(level)} {subject.unit}{side_of(side)}"), axis, level
        )
        for axis, ((name, side), level) in enumerate(zip(PLANES.items(), (low + high) / 2, strict=True))
    ]
    note = tag("p", f"Dots: eam points within {BESIDE:g} {subject.unit} of the plane.", class_="soft")
    return Section("slices", "Cross-sections", join(grouped(*pictures), _legend(subject), note))


def outline_section(subject: Subject) -> Section | None:
    """In 2D: each shown estimate with the truth, the prior in its pose, and the points in the colours of
    their distance.
    """
    if subject.case.dimension == 3:
        return None
    everything = np.vstack(
        [surface.vertices for _, _, surface in _surfaces(subject)] + [subject.case.points.xyz]
    )
    frame = _frame(everything.min(axis=0), everything.max(axis=0))
    pictures = grouped(*(_picture(subject, name, frame) for name in subject.shown))
    names = [(name, classes) for one in subject.shown for name, classes, _ in named_outlines(subject, one)]
    gaps = point_field(subject)
    note = (
        f"Points: distance from the outline, from {gaps.low:.2g} (pale) to {gaps.high:.2g} "
        f"{gaps.unit} (dark red)."
    )
    return Section("pictures", "Side by side", join(pictures, legend(names), tag("p", note, class_="soft")))


def _picture(subject: Subject, name: str, frame: Frame) -> Html:
    """One estimate over the truth and the prior, which is drawn as this estimate's similarity moved it."""
    result = subject.results[name]
    outlines = [
        Outline(label, classes, surface.vertices[surface.faces])
        for label, classes, surface in named_outlines(subject, name)
    ]
    points = result.run.points.of("eam")
    colours = _css(colours_of(points.columns[f"distance_{result.key}_{subject.unit}"], point_field(subject)))
    return drawing(name, outlines, points.xyz, colours, frame)


def named_outlines(subject: Subject, name: str) -> list[tuple[str, str, Surface]]:
    """Name, CSS classes and surface of the prior, the truth and one estimate, in the order of drawing."""
    estimate = subject.results[name].estimate
    placed = subject.case.prior.transformed(estimate.T_map_prior)
    truth = [one for one in _surfaces(subject) if one[0] == "truth"]
    return [("prior", "prior", placed), *truth, (name, f"s{subject.style(name) % STYLES}", estimate.surface)]


def _slice(subject: Subject, title: str, axis: int, level: float) -> Html | None:
    outlines = [
        Outline(name, classes, slice_surface(surface, axis, level))
        for name, classes, surface in _surfaces(subject)
    ]
    corners = np.concatenate([one.segments.reshape(-1, 2) for one in outlines])
    if len(corners) == 0:
        return None
    points = subject.case.points.of("eam").xyz
    near = np.delete(points[np.abs(points[:, axis] - level) < BESIDE], axis, axis=1)
    frame = _frame(corners.min(axis=0), corners.max(axis=0), turned(subject.case.frame, axis))
    return drawing(title, outlines, near, ["var(--soft)"] * len(near), frame)


def turned(frame: str, axis: int) -> tuple[bool, bool]:
    """Whether a section across an axis is mirrored and turned over, so that `PLANES` holds, head up, in the
    axial plane front up.
    """
    side = frame == "RAS"
    return (not side if axis == 0 else side, axis == 2 and not side)


def _surfaces(subject: Subject) -> list[tuple[str, str, Surface]]:
    """Name, CSS classes and surface of the truth and the shown estimates, in the order of drawing."""
    truth = subject.case.truth.surface if subject.case.truth else None
    shown = [
        (name, line_class(subject.style(name)), subject.results[name].estimate.surface)
        for name in subject.shown
    ]
    return [("truth", "truth", truth), *shown] if truth is not None else shown


def _legend(subject: Subject) -> Html:
    return legend([(name, classes) for name, classes, _ in _surfaces(subject)])


def _frame(low: Array, high: Array, flip: tuple[bool, bool] = (False, False)) -> Frame:
    margin = MARGIN * float((high - low).max())
    return Frame(low - margin, high + margin, flip)


def _css(colours: Array) -> list[str]:
    return ["#" + "".join(f"{round(255 * channel):02x}" for channel in colour) for colour in colours]
