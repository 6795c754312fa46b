"""A finished run in a window: the estimates of the report, switched by keys."""

from __future__ import annotations

import logging
import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface
from .browser import has_display
from .drawing.fields import colours_of, point_field, shown_fields
from .drawing.figures import INK
from .drawing.labels import Sheet, ends, sheet
from .drawing.open3d_meshes import balls, edges, mesh, plain, rgb
from .mapping.views import orientation
from .palette import GREY, LIGHT
from .subject import Subject, read_subject

SIZE = (1200, 900)
PLAIN_COLOUR = (0.75, 0.75, 0.77)
EDGES = {"prior": ("grey", LIGHT[GREY]), "truth": ("black", INK)}  # in the colours of the report
LINE = 0.13  # radii: a label may be longer than its bar, so that the next one stands a line below it
F1 = 290  # the key's code; for letters and digits it is that of the character
log = logging.getLogger("o3dls")


@dataclass(frozen=True)
class Choice:
    """A choice says what the window shows: an estimate, a field (None: plain) and what stands around the
    surface.
    """

    estimate: int
    field: int | None = 0
    points: bool = True
    landmarks: bool = True
    prior: bool = False
    truth: bool = False
    view: int = 0


class Stand:
    """This gives the run as geometry for Open3D, in the colours and scales of its report; it knows no
    window.
    """

    def __init__(self, subject: Subject) -> None:
        self.subject = replace(subject, shown=list(subject.results))
        self.names = list(subject.results)
        self.first = Choice(len(self.names) - 1)
        self.fields = shown_fields(subject)
        self.gaps = point_field(subject)
        self.seen = orientation(self.subject)
        self.views = self.seen.views()  # name, and the direction (3,) from where it looks

    def keys(self) -> dict[str, Callable[[Choice], Choice]]:
        """Return what each key makes of a choice."""
        numbers = {
            str(k + 1): lambda choice, k=k: replace(choice, estimate=k)
            for k in range(min(9, len(self.names)))
        }
        views = {f"F{k + 1}": lambda choice, k=k: replace(choice, view=k) for k in range(len(self.views))}
        return {
            **numbers,
            **views,
            "F": lambda choice: replace(choice, field=self._next_field(choice.field)),
            "P": lambda choice: replace(choice, points=not choice.points),
            "L": lambda choice: replace(choice, landmarks=not choice.landmarks),
            "G": lambda choice: replace(choice, prior=not choice.prior),
            "T": lambda choice: replace(choice, truth=not choice.truth),
        }

    def help(self) -> str:
        """Name the keys in one line."""
        views = ", ".join(f"F{k + 1} {name}" for k, name in enumerate(self.views))
        return (
            "1-9 estimate, F next colours, P points, L landmarks, G prior, T truth, "
            f"{views}, R reset view, H these keys, Q quit"
        )

    def caption(self, choice: Choice) -> str:
        """Say in one line what is to be seen."""
        name, view = self.names[choice.estimate], list(self.views)[choice.view]
        if choice.field is None:
            return f"{name}, {view}"
        field = self.fields[choice.field]
        return f"{name}, {view}: {field.label}, {' to '.join(ends(field))} ({field.low_end}: low)"

    def geometries(self, choice: Choice) -> list[Any]:
        """Make the Open3D geometry of a choice: the surface in colours, points as balls, prior and truth as
        edges, and the words that name them.
        """
        name = self.names[choice.estimate]
        found = [mesh(self.subject.surfaces[name], self._vertex_colours(name, choice))]
        if choice.points:
            found.append(self._draw_points(name))
        if choice.prior:
            pose = self.subject.results[name].estimate.T_map_prior
            found.append(edges(self.subject.case.prior.transformed(pose), EDGES["prior"][1]))
        truth = self._true_surface
        if choice.truth and truth is not None:
            found.append(edges(truth, EDGES["truth"][1]))
        return [*found, *self._draw_words(choice)]

    @property
    def _true_surface(self) -> Surface | None:
        return self.subject.case.truth.surface if self.subject.case.truth else None

    def page(self, choice: Choice) -> Sheet:
        """Return the sheet on which words stand in the view of a choice: about the last surface, so that they
        stay there.
        """
        last = self.subject.last.estimate.surface
        return sheet(last, list(self.views.values())[choice.view], self.seen.up)

    def _next_field(self, field: int | None) -> int | None:
        """Go through all fields, then plain, then again from the first."""
        if field is None:
            return 0 if self.fields else None
        return field + 1 if field + 1 < len(self.fields) else None

    def _vertex_colours(self, name: str, choice: Choice) -> Array:
        surface = self.subject.surfaces[name]
        field = self.fields[choice.field] if choice.field is not None and self.fields else None
        if field is None or field.key not in surface.fields:
            return np.tile(PLAIN_COLOUR, (len(surface.vertices), 1))
        return colours_of(surface.fields[field.key], field)

    def _draw_points(self, name: str) -> Any:
        """Draw all points as one mesh of balls in the colours of their distance."""
        result = self.subject.results[name]
        colours = colours_of(result.point_distances, self.gaps)
        return balls(result.drawn_points.xyz, colours)

    def _draw_words(self, choice: Choice) -> list[Any]:
        """Draw the names of the estimate, the view, the landmarks and what is drawn as edges, and colour bars
        with their ends.
        """
        page = self.page(choice)
        shown = [name for name in EDGES if getattr(choice, name) and (name == "prior" or self._true_surface)]
        edged = ", ".join(f"{EDGES[name][0]} edges: {name}" for name in shown)
        named = f"{self.names[choice.estimate]}, {list(self.views)[choice.view]}"
        said = [page.text(named, (-1.0, 1.3)), page.text(edged, (-1.0, 1.16))]
        bars = [(self.fields[choice.field], -1.0)] if choice.field is not None and self.fields else []
        bars += [(self.gaps, 0.1)] if choice.points else []
        for row, (field, left) in enumerate(bars):
            words = ((" to ".join(ends(field)), -1.42), (field.label, -1.55 - LINE * row))
            said += [page.text(line, (left, low)) for line, low in words]
        found = [mesh(*page.bar(field, left, left + 0.8, -1.3), lit=False) for field, left in bars]
        marks = self.subject.case.points.of("landmark")
        if choice.landmarks and len(marks):
            found.append(balls(marks.xyz, np.tile(rgb(INK), (len(marks), 1))))
            names = marks.columns.get("name", np.full(len(marks), ""))
            said += [page.before(str(name), at) for name, at in zip(names, marks.xyz, strict=True)]
        return [*found, *(plain(one, INK) for one in said if one is not None)]


def open_window(folder: str | Path) -> None:
    """Open a window on a finished run and return when it is closed; keys and what is shown are told in the
    log.

    Raises InputError where there is no display, or the run is 2D.
    """
    subject = read_subject([Path(folder)])
    named = shlex.quote(str(folder))
    if subject.case.dimension == 2:
        raise InputError(f"{folder}: is a run in 2D; its pictures are in the report: o3dls report {named}")
    if not has_display():
        raise InputError(
            f"there is no display here for a window; look at the page in a browser: o3dls view {named}"
        )
    _run_window(Stand(subject), f"o3dls: {subject.case.name}", named)


def _run_window(stand: Stand, title: str, folder: str) -> None:
    import open3d as o3d

    window = o3d.visualization.VisualizerWithKeyCallback()
    if not window.create_window(title, *SIZE):
        raise InputError(
            f"no window could be opened on this display; look at the page in a browser: o3dls view {folder}"
        )
    window.get_render_option().mesh_show_back_face = True
    state = stand.first
    _show_choice(window, stand, state, first=True)

    def on(key: str, change: Callable[[Choice], Choice]) -> Callable[[Any], bool]:
        def press(_: Any) -> bool:
            nonlocal state
            state = change(state)
            _show_choice(window, stand, state, turned=key in views)
            return True

        return press

    views = {f"F{k + 1}": F1 + k for k in range(len(stand.views))}
    for key, change in stand.keys().items():
        window.register_key_callback(views.get(key) or ord(key), on(key, change))
    window.register_key_callback(ord("H"), lambda _: log.info(stand.help()))
    log.info(stand.help())
    window.run()
    window.destroy_window()


def _show_choice(
    window: Any, stand: Stand, choice: Choice, *, first: bool = False, turned: bool = False
) -> None:
    """Put a choice into the window; the camera stays but for the first time, and where a view is chosen."""
    window.clear_geometries()
    for geometry in stand.geometries(choice):
        window.add_geometry(geometry, reset_bounding_box=first)
    if first or turned:
        look = window.get_view_control()
        page = stand.page(choice)
        look.set_front(page.axes[2].tolist())
        look.set_up(page.axes[1].tolist())
        look.set_lookat(page.centre.tolist())
    log.info(stand.caption(choice))
