"""Cross-sections: where a plane meets surfaces in 3D, and whole outlines in 2D, as SVG in true
proportions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ...geometry.surface import Surface
from ..markup import Html, tag

SIZE = 420
MARGIN = 12


@dataclass(frozen=True)
class Outline:
    """Segments (n, 2, 2) of one surface with its name and CSS classes."""

    name: str
    classes: str
    segments: Array


def slice_surface(surface: Surface, axis: int, level: float) -> Array:
    """Segments (n, 2, 2), in the two other coordinates, where a surface meets the plane x[axis] = level."""
    corners = surface.vertices[surface.faces]
    above = corners[:, :, axis] > level
    crossing = corners[above.any(axis=1) & ~above.all(axis=1)]
    above = crossing[:, :, axis] > level
    # the corner alone on its side
    lone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    rows = np.arange(len(crossing))
    ends = [_between(crossing[rows, lone], crossing[rows, (lone + k) % 3], axis, level) for k in (1, 2)]
    return np.delete(np.stack(ends, axis=1), axis, axis=2)


def _between(a: Array, b: Array, axis: int, level: float) -> Array:
    share = (level - a[:, axis]) / (b[:, axis] - a[:, axis])
    return a + share[:, None] * (b - a)


@dataclass(frozen=True)
class Frame:
    """What part of the plane is drawn: low and high (2,) corners, and whether each axis is turned so that it
    runs right and up.
    """

    low: Array
    high: Array
    flip: tuple[bool, bool] = (False, False)

    @property
    def scale(self) -> float:
        return (SIZE - 2 * MARGIN) / float((self.high - self.low).max())

    @property
    def size(self) -> Array:
        return np.asarray((self.high - self.low) * self.scale + 2 * MARGIN)

    def place(self, at: Array) -> Array:
        """Pixels (..., 2) of positions (..., 2); rows of a picture count down."""
        flat = MARGIN + (at - self.low) * self.scale
        turned = np.array([self.flip[0], not self.flip[1]])
        return np.where(turned, self.size - flat, flat)


def drawing(
    title: str, outlines: Sequence[Outline], points: Array, colours: Sequence[str], frame: Frame
) -> Html:
    """Outlines, and points (n, 2) in CSS colours, in true proportions."""
    lines = [
        tag("path", d=_path(frame.place(one.segments)), class_=f"series {one.classes}")
        for one in outlines
        if len(one.segments)
    ]
    inside = np.all((points >= frame.low) & (points <= frame.high), axis=1).tolist()
    dots = [
        tag("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r="3.5", fill=colour, class_="dot")
        for (x, y), colour, keep in zip(frame.place(points), colours, inside, strict=True)
        if keep
    ]
    width, height = frame.size
    picture = tag(
        "svg",
        *lines,
        *dots,
        viewBox=f"0 0 {width:.0f} {height:.0f}",
        class_="chart slice",
        role="img",
        aria_label=title,
    )
    return tag("figure", tag("h3", title), picture, class_="plot")


def _path(segments: Array) -> str:
    """SVG path of segments (n, 2, 2), joined where one ends where the next begins."""
    parts = []
    last = ""
    for (ax, ay), (bx, by) in segments:
        start, end = f"{ax:.1f} {ay:.1f}", f"{bx:.1f} {by:.1f}"
        parts.append(f"L{end}" if start == last else f"M{start}L{end}")
        last = end
    return "".join(parts)
