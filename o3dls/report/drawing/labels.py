"""Words and colour bars as meshes, for a window that draws no text; they face one of the views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Array
from ...geometry.surface import Surface
from .colour_maps import colour_table
from .fields import Field

LETTER = 12.0  # height of a capital in the units of Open3D's text
SMALL = 0.075  # height of a capital, as a share of the radius of what is shown
THIN = 0.06  # height of a colour bar, as a share of the radius
BEFORE = 0.35  # from a landmark to its name, as a share of the radius
COLOURS = 32  # steps of a colour bar


@dataclass(frozen=True, eq=False)
class Sheet:
    """A sheet is a plane that faces a view: its centre (3,), its rows right, up and towards the viewer (3,
    3), and the length (mm) of its unit, the radius of what is shown.
    """

    centre: Array
    axes: Array
    radius: float

    def place(self, flat: Array) -> Array:
        """Return positions (n, 3) of places (n, 2) to the right and up, in radii."""
        return np.asarray(self.centre + self.radius * flat @ self.axes[:2])

    def text(self, words: str, at: tuple[float, float]) -> Surface | None:
        """Draw words that begin at a place; None where there is no letter that can be drawn."""
        return self._write_words(words, self.place(np.array([at]))[0])

    def before(self, words: str, at: Array) -> Surface | None:
        """Draw words before a position (3,), so that what is there does not hide them."""
        return self._write_words(words, at + self.radius * BEFORE * self.axes[2])

    def _write_words(self, words: str, origin: Array) -> Surface | None:
        if not words:
            return None
        import open3d as o3d

        drawn: Any = o3d.t.geometry.TriangleMesh.create_text(words, depth=0).to_legacy()
        flat = np.asarray(drawn.vertices)[:, :2]
        if len(flat) == 0:
            return None
        size = SMALL * self.radius / LETTER
        return Surface(origin + size * flat @ self.axes[:2], np.asarray(drawn.triangles))

    def bar(self, field: Field, left: float, right: float, low: float) -> tuple[Surface, Array]:
        """Draw the colours of a field as a strip from left to right above `low`, and return it with the
        colour (n, 3) of each corner.
        """
        x = np.repeat(np.linspace(left, right, COLOURS), 2)
        flat = np.column_stack([x, np.tile([low, low + THIN], COLOURS)])
        corners = np.array([[0, 2, 1], [1, 2, 3]])
        faces = (2 * np.arange(COLOURS - 1)[:, None, None] + corners).reshape(-1, 3)
        table = colour_table(field.colours)
        rows = np.round(np.linspace(0, len(table) - 1, COLOURS)).astype(int)
        return Surface(self.place(flat), faces), np.repeat(table[rows], 2, axis=0)


def sheet(surface: Surface, towards: Array, up: Array) -> Sheet:
    """Place the sheet before a surface as seen from a direction (3,)."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    centre = (low + high) / 2
    radius = float(np.linalg.norm(surface.vertices - centre, axis=1).max())
    towards = towards / np.linalg.norm(towards)
    right = np.cross(up, towards)
    right = right / np.linalg.norm(right)
    return Sheet(centre, np.array([right, np.cross(towards, right), towards]), radius)


def ends(field: Field) -> tuple[str, str]:
    """Return the values at both ends of a field's colours, with its unit."""
    return f"{field.low:.3g}", f"{field.high:.3g} {field.unit}".rstrip()
