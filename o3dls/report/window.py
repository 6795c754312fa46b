"""A finished run in a window: the estimates of the report, switched by keys."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface
from .drawing.display import decimated
from .drawing.fields import Field, colours_of, known_fields, point_field
from .drawing.views import orientation
from .subject import Subject, read_subject

SIZE = (1200, 900)
EDGE_FACES = 4000  # of prior and truth, which are drawn as edges: more would hide the surface
GHOST_COLOUR, PLAIN_COLOUR = (0.55, 0.58, 0.64), (0.75, 0.75, 0.77)
log = logging.getLogger("o3dls")
KEYS = (
    "1-9 estimate, F next colours, P points, G ghost of the prior, T truth, R reset view, H these "
    "keys, Q quit"
)


@dataclass(frozen=True)
class Choice:
    """What the window shows: an estimate, a field (None: plain) and what stands around the surface."""

    estimate: int
    field: int | None = 0
    points: bool = True
    ghost: bool = False
    truth: bool = False


class Stand:
    """The run as geometry for Open3D; knows no window."""

    def __init__(self, subject: Subject) -> None:
        self.subject = replace(subject, shown=list(subject.results))
        self.names = list(subject.results)
        self.first = Choice(len(self.names) - 1)

    @cached_property
    def fields(self) -> list[Field]:
        return known_fields(list(self.subject.surfaces.values()), self.subject.unit)

    def keys(self) -> dict[str, Callable[[Choice], Choice]]:
        """What each key makes of a choice."""
        numbers = {
            str(k + 1): lambda choice, k=k: replace(choice, estimate=k)
            for k in range(min(9, len(self.names)))
        }
        return {
            **numbers,
            "F": lambda choice: replace(choice, field=self._next(choice.field)),
            "P": lambda choice: replace(choice, points=not choice.points),
            "G": lambda choice: replace(choice, ghost=not choice.ghost),
            "T": lambda choice: replace(choice, truth=not choice.truth),
        }

    def caption(self, choice: Choice) -> str:
        """What is to be seen, in one line."""
        name = self.names[choice.estimate]
        if choice.field is None:
            return name
        field = self.fields[choice.field]
        ends = f"{field.low:.2g} ({field.low_end}) to {field.high:.2g} {field.unit}"
        return f"{name}: {field.label}, {ends}".rstrip()

    def geometries(self, choice: Choice) -> list[Any]:
        """Open3D geometry of a choice: the surface in colours, points as balls, prior and truth as edges."""
        name = self.names[choice.estimate]
        found = [_mesh(self.subject.surfaces[name], self._colours(name, choice))]
        if choice.points:
            found.append(self._balls(name))
        if choice.ghost:
            pose = self.subject.results[name].estimate.T_map_prior
            found.append(_edges(self.subject.case.prior.transformed(pose), GHOST_COLOUR))
        truth = self.subject.case.truth.surface if self.subject.case.truth else None
        if choice.truth and truth is not None:
            found.append(_edges(truth, (0.1, 0.1, 0.1)))
        return found

    def _next(self, field: int | None) -> int | None:
        """Through all fields, then plain, then again from the first."""
        if field is None:
            return 0 if self.fields else None
        return field + 1 if field + 1 < len(self.fields) else None

    def _colours(self, name: str, choice: Choice) -> Array:
        surface = self.subject.surfaces[name]
        field = self.fields[choice.field] if choice.field is not None and self.fields else None
        if field is None or field.key not in surface.fields:
            return np.tile(PLAIN_COLOUR, (len(surface.vertices), 1))
        return colours_of(surface.fields[field.key], field)

    def _balls(self, name: str) -> Any:
        """All points as one mesh of balls in the colours of their distance."""
        import open3d as o3d

        result = self.subject.results[name]
        ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 8)
        vertices, faces = np.asarray(ball.vertices), np.asarray(ball.triangles)
        centres = result.drawn_points.xyz
        colours = colours_of(result.point_distances, point_field(self.subject))
        n = len(centres)
        every = (centres[:, None] + vertices[None]).reshape(-1, 3)
        index = (faces[None] + len(vertices) * np.arange(n)[:, None, None]).reshape(-1, 3)
        return _mesh(Surface(every, index), np.repeat(colours, len(vertices), axis=0))


def view(folder: str | Path) -> None:
    """Open a window on a finished run and return when it is closed; keys and what is shown are told in the
    log.

    Raises InputError where there is no display, or the run is 2D.
    """
    subject = read_subject([Path(folder)])
    if subject.case.dimension == 2:
        raise InputError(f"{folder}: is a run in 2D; its pictures are in the report: o3dls report {folder}")
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise InputError(
            f"there is no display here for a window; look at the page that o3dls report {folder} writes"
        )
    _run_window(Stand(subject), f"o3dls: {subject.case.name}", str(folder))


def _run_window(stand: Stand, title: str, folder: str) -> None:
    import open3d as o3d

    window = o3d.visualization.VisualizerWithKeyCallback()
    if not window.create_window(title, *SIZE):
        raise InputError(
            f"no window could be opened on this display; look at the page that o3dls report {folder} writes"
        )
    window.get_render_option().mesh_show_back_face = True
    state = stand.first
    _show(window, stand, state, first=True)

    def on(change: Callable[[Choice], Choice]) -> Callable[[Any], bool]:
        def press(_: Any) -> bool:
            nonlocal state
            state = change(state)
            _show(window, stand, state)
            return True

        return press

    for key, change in stand.keys().items():
        window.register_key_callback(ord(key), on(change))
    window.register_key_callback(ord("H"), lambda _: log.info(KEYS))
    log.info(KEYS)
    window.run()
    window.destroy_window()


def _show(window: Any, stand: Stand, choice: Choice, *, first: bool = False) -> None:
    """Put a choice into the window; the camera stays but for the first time."""
    window.clear_geometries()
    for geometry in stand.geometries(choice):
        window.add_geometry(geometry, reset_bounding_box=first)
    if first:
        look = window.get_view_control()
        seen = orientation(stand.subject)
        look.set_front(seen.front.tolist())
        look.set_up(seen.up.tolist())
    log.info(stand.caption(choice))


def _mesh(surface: Surface, colours: Array) -> Any:
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(surface.vertices),
        o3d.utility.Vector3iVector(surface.faces.astype(np.int32)),
    )
    mesh.vertex_colors = o3d.utility.Vector3dVector(colours)
    mesh.compute_vertex_normals()
    return mesh


def _edges(surface: Surface, colour: tuple[float, float, float]) -> Any:
    import open3d as o3d

    coarse = decimated(replace(surface, fields={}), EDGE_FACES, EDGE_FACES)
    lines = o3d.geometry.LineSet.create_from_triangle_mesh(_mesh(coarse, np.zeros_like(coarse.vertices)))
    lines.paint_uniform_color(colour)
    return lines
