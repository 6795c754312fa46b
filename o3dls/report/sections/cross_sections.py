"""Cross-sections of surfaces in 3D, along the axes that the views look along."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from ...evaluation.distances import distances
from ...geometry.surface import Surface
from ..drawing.charts import grouped, legend, line_class
from ..drawing.slices import PLANES, Frame, Outline, drawing, slice_surface
from ..mapping.views import Orientation, orientation
from ..markup import Html, join, tag
from ..section import Section
from ..subject import Subject

BESIDE = 2.0  # mm beside a plane within which points are drawn
MARGIN = 0.03  # of the extent, around the outlines
Named = dict[str, tuple[str, Surface]]  # CSS classes and surface by name, in the order of drawing


@dataclass(frozen=True, eq=False)
class Cut:
    """A cut is made along one plane: its title, the rows right, up and across (3, 3) of its axes, its level
    across, and what lies to the left, to the right, below and above.
    """

    title: str
    axes: Array
    level: float
    sides: tuple[str, str, str, str]

    def outline(self, surface: Surface) -> Array:
        """Return segments (n, 2, 2), right and up, where the surface meets the plane."""
        return slice_surface(replace(surface, vertices=surface.vertices @ self.axes.T), 2, self.level)

    def in_space(self, flat: Array) -> Array:
        """Return positions (n, 3) in the map frame of places (n, 2) in the plane."""
        return np.asarray(np.column_stack([flat, np.full(len(flat), self.level)]) @ self.axes)

    def beside(self, xyz: Array) -> Array:
        """Return places (k, 2) in the plane of those points (n, 3) that are within BESIDE of it."""
        seen = xyz @ self.axes.T
        return np.asarray(seen[np.abs(seen[:, 2] - self.level) < BESIDE, :2])


def slice_section(subject: Subject) -> Section | None:
    """Draw outlines of the prior, the truth and the shown estimates in three planes through the middle of the
    last, all on one scale; a plane that the last does not meet is left out.
    """
    if subject.case.dimension == 2:
        return None
    surfaces = _list_surfaces(subject)
    seen = orientation(subject)
    cuts = [cut for cut in _make_cuts(subject, seen) if len(cut.outline(surfaces[subject.last.name][1]))]
    drawn = [{name: cut.outline(surface) for name, (_, surface) in surfaces.items()} for cut in cuts]
    corners = [np.concatenate(list(one.values())).reshape(-1, 2) for one in drawn]
    frames = _make_frames(cuts, corners, subject.unit)
    pictures = [_draw_cut(subject, surfaces, *parts) for parts in zip(cuts, drawn, frames, strict=True)]
    note = (
        f"Planes through the middle of {subject.last.name}, on one scale. Axes: "
        f"{seen.known_by}. Dots: eam points within {BESIDE:g} {subject.unit} of the plane."
    )
    names = legend([(name, classes) for name, (classes, _) in surfaces.items()])
    return Section("slices", "Cross-sections", join(grouped(*pictures), names, tag("p", note, class_="soft")))


def _list_surfaces(subject: Subject) -> Named:
    prior = subject.case.prior.transformed(subject.last.estimate.T_map_prior)
    truth = subject.case.truth.surface if subject.case.truth else None
    found: Named = {f"prior, in the pose of {subject.last.name}": ("prior", prior)}
    if truth is not None:
        found["truth"] = ("truth", truth)
    for name in subject.shown:
        found[name] = (line_class(subject.style(name)), subject.results[name].estimate.surface)
    return found


def _make_cuts(subject: Subject, seen: Orientation) -> list[Cut]:
    directions = np.array([seen.left, seen.front, seen.up])
    at = subject.last.estimate.surface.vertices @ directions.T
    middle = (at.min(axis=0) + at.max(axis=0)) / 2
    sides = seen.sides()
    cuts = []
    for name, (across, right, up) in PLANES.items():
        letter = "xyz"[across]
        title = name if seen.patient else f"across the prior's {letter} axis"
        if subject.case.frame != "unknown":
            title += f", {letter} = {round(middle[across] * directions[across, across])} {subject.unit}"
        ends = (sides[right][1], sides[right][0], sides[up][1], sides[up][0])
        cuts.append(Cut(title, directions[[right, up, across]], float(middle[across]), ends))
    return cuts


def _make_frames(cuts: list[Cut], corners: list[Array], unit: str) -> list[Frame]:
    """Make a frame about the corners (n, 2) of each plane, all of one size, so of one scale."""
    low, high = (np.array([pick(one, axis=0) for one in corners]) for pick in (np.min, np.max))
    half = (high - low).max(axis=0) / 2
    half = half + MARGIN * half.max()
    return [
        Frame(middle - half, middle + half, unit, cut.sides)
        for middle, cut in zip((low + high) / 2, cuts, strict=True)
    ]


def _draw_cut(subject: Subject, surfaces: Named, cut: Cut, drawn: dict[str, Array], frame: Frame) -> Html:
    points = cut.beside(subject.case.points.of("eam").xyz)
    outlines = [Outline(name, classes, drawn[name]) for name, (classes, _) in surfaces.items()]
    outside = len(points) - int(frame.holds(points).sum())
    beyond = f", {outside} of them outside the picture" if outside else ""
    count = f"{len(points)} point{'' if len(points) == 1 else 's'}"
    gaps = _describe_gaps(subject, surfaces, cut, drawn[subject.last.name])
    caption = f"{count} within {BESIDE:g} {subject.unit}{beyond}. {gaps}"
    return drawing(cut.title, outlines, points, ["var(--soft)"] * len(points), frame, caption=caption)


def _describe_gaps(subject: Subject, surfaces: Named, cut: Cut, segments: Array) -> str:
    """Say how far the outline (n, 2, 2) of the last estimate is from the other surfaces."""
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    middles = cut.in_space(segments.mean(axis=1))
    means = {
        name.partition(",")[0]: np.average(distances(middles, surface), weights=lengths)
        for name, (_, surface) in surfaces.items()
        if name != subject.last.name
    }
    said = ", ".join(f"{name} {mean:.2f} {subject.unit}" for name, mean in means.items())
    return f"Mean distance from {subject.last.name} here to: {said}."
