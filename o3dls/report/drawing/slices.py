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
MARGIN = 12  # beside the outlines
STRIP = 34  # above and below them, for the scale bar and the names of the sides
# The direction a plane stands across, and those that run right and up in its picture: left, front and up are
# 0, 1 and 2. So a transverse section has the front above and the left on the right, as a CT has.
PLANES = {"sagittal": (0, 1, 2), "coronal": (1, 0, 2), "axial": (2, 0, 1)}


@dataclass(frozen=True)
class Outline:
    """An outline has the segments (n, 2, 2) of one surface with its name and CSS classes."""

    name: str
    classes: str
    segments: Array


def slice_surface(surface: Surface, axis: int, level: float) -> Array:
    """Return segments (n, 2, 2), in the two other coordinates, where a surface meets the plane x[axis] =
    level.
    """
    corners = surface.vertices[surface.faces]
    above = corners[:, :, axis] > level
    crossing = corners[above.any(axis=1) & ~above.all(axis=1)]
    above = crossing[:, :, axis] > level
    # of each triangle the corner that is alone on its side of the plane
    lone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    rows = np.arange(len(crossing))
    ends = [_cross_level(crossing[rows, lone], crossing[rows, (lone + k) % 3], axis, level) for k in (1, 2)]
    return np.delete(np.stack(ends, axis=1), axis, axis=2)


def _cross_level(a: Array, b: Array, axis: int, level: float) -> Array:
    share = (level - a[:, axis]) / (b[:, axis] - a[:, axis])
    return a + share[:, None] * (b - a)


@dataclass(frozen=True)
class Frame:
    """A frame says what part of a plane is drawn: low and high (2,) corners in a unit, and what lies to the
    left, to the right, below and above, where that has names.

    Frames of one size have one scale, wherever the page shows them in one width.
    """

    low: Array
    high: Array
    unit: str
    sides: tuple[str, str, str, str] | None = None

    @property
    def scale(self) -> float:
        return (SIZE - 2 * MARGIN) / float((self.high - self.low).max())

    @property
    def size(self) -> Array:
        return np.asarray((self.high - self.low) * self.scale + 2 * np.array([MARGIN, STRIP]))

    def place(self, at: Array) -> Array:
        """Return pixels (..., 2) of positions (..., 2); rows of a picture count down."""
        flat = np.array([MARGIN, STRIP]) + (at - self.low) * self.scale
        return np.where([False, True], self.size - flat, flat)

    def holds(self, at: Array) -> Array:
        """Return whether positions (n, 2) lie inside, (n,)."""
        return np.asarray(np.all((at >= self.low) & (at <= self.high), axis=1))


def drawing(
    title: str,
    outlines: Sequence[Outline],
    points: Array,
    colours: Sequence[str],
    frame: Frame,
    *,
    caption: str | None = None,
) -> Html:
    """Draw outlines, and points (n, 2) in CSS colours, in true proportions with a scale bar; screen readers
    read the caption for the picture.
    """
    lines = [
        tag("path", d=write_path(frame.place(one.segments)), class_=f"series {one.classes}")
        for one in outlines
        if len(one.segments)
    ]
    dots = [
        tag("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r="3.5", fill=colour, class_="dot")
        for (x, y), colour, inside in zip(
            frame.place(points), colours, frame.holds(points).tolist(), strict=True
        )
        if inside
    ]
    width, height = frame.size
    picture = tag(
        "svg",
        *lines,
        *dots,
        *decoration(frame),
        viewBox=f"0 0 {width:.0f} {height:.0f}",
        class_="chart slice",
        role="img",
        aria_label=f"{title}: {', '.join(one.name for one in outlines)}; {len(dots)} points",
    )
    said = tag("figcaption", tag("small", caption)) if caption else None
    return tag("figure", tag("h3", title), picture, said, class_="plot")


def bar_length(width: float) -> float:
    """Return the longest of the round lengths, 1, 2 or 5 times a power of ten, that is at most 2/7 of a
    width.
    """
    power = 10.0 ** np.floor(np.log10(width / 5))
    return float(power * max(step for step in (1, 2, 5, 10) if step * power <= width / 3.5))


def decoration(frame: Frame) -> list[Html]:
    """Return the scale bar of a picture, and the names of its sides where they have any."""
    return [*_scale_bar(frame), *_side_names(frame)]


def _scale_bar(frame: Frame) -> list[Html]:
    length = bar_length(float((frame.high - frame.low)[0]))
    end, row = MARGIN + length * frame.scale, STRIP - MARGIN
    line = f"M{MARGIN} {row - 4}v8M{MARGIN} {row}H{end:.1f}M{end:.1f} {row - 4}v8"
    return [
        tag("path", d=line, class_="axis"),
        tag("text", f"{length:g} {frame.unit}", x=f"{end + 6:.1f}", y=row + 5),
    ]


def _side_names(frame: Frame) -> list[Html]:
    if frame.sides is None:
        return []
    left, right, below, above = frame.sides
    width, height = frame.size
    low, middle = f"{height - MARGIN:.0f}", f"{width / 2:.0f}"
    return [
        tag("text", f"← {left}", x=MARGIN, y=low),
        tag("text", f"{right} →", x=f"{width - MARGIN:.0f}", y=low, text_anchor="end"),
        tag("text", f"{below} ↓", x=middle, y=low, text_anchor="middle"),
        tag("text", f"{above} ↑", x=f"{width - MARGIN:.0f}", y=STRIP - MARGIN + 5, text_anchor="end"),
    ]


def write_path(segments: Array, tolerance: float = 0.0) -> str:
    """Write the SVG path of segments (n, 2, 2), in pixels, as few long lines: dashes begin anew with each.
    Corners are left out that stand off the lines without them by at most the tolerance.
    """
    ends = [[f"{x:.1f} {y:.1f}" for x, y in segment] for segment in segments]
    at: dict[str, list[int]] = {}
    for k, (start, end) in enumerate(ends):
        for place in {start, end} if start != end else ():
            at.setdefault(place, []).append(k)
    left = {k for k, (start, end) in enumerate(ends) if start != end}
    # an open line begins at an end of it, where one segment ends and no other begins
    first = [k for k in sorted(left) if any(len(at[place]) == 1 for place in ends[k])]
    lines = [_follow_line(k, ends, at, left) for k in (*first, *sorted(left)) if k in left]
    return "".join("M" + "L".join(_thin_line(line, tolerance) if tolerance else line) for line in lines)


def _thin_line(line: list[str], tolerance: float) -> list[str]:
    """Return the places of a line without those that stand off it by at most the tolerance (Douglas and
    Peucker 1973).
    """
    at = np.array([place.split() for place in line], dtype=np.float64)
    kept = {0, len(line) - 1}
    waiting = [(0, len(line) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        way, off = at[last] - at[first], at[first + 1 : last] - at[first]
        share = np.clip(off @ way / max(way @ way, 1e-12), 0.0, 1.0)  # of a closed line the ends are one
        far = np.linalg.norm(off - share[:, None] * way, axis=1)
        if far.max() > tolerance:
            worst = first + 1 + int(far.argmax())
            kept.add(worst)
            waiting += [(first, worst), (worst, last)]
    return [line[k] for k in sorted(kept)]


def _follow_line(k: int, ends: list[list[str]], at: dict[str, list[int]], left: set[int]) -> list[str]:
    """Return the places of the line that goes on from a segment, and take its segments out of those left."""
    start, end = ends[k]
    line = [end, start] if len(at[end]) == 1 else [start, end]
    left.discard(k)
    while (following := next((j for j in at[line[-1]] if j in left), None)) is not None:
        left.discard(following)
        a, b = ends[following]
        line.append(b if a == line[-1] else a)
    return line
