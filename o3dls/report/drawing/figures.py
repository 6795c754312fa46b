"""Static pictures: the same surfaces for paper, slides and browsers without WebGL."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from ...arrays import Array
from ...geometry.surface import Surface
from ..mapping.views import orientation
from ..subject import Subject
from .caption import caption
from .fields import Field, colour_table, colours_of, known_fields, point_field

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from .raster import View

PIXELS = (640, 500)  # width and height of one picture
MARGIN = 1.12
WHOLE = (0.02, 0.03, 0.96, 0.95)  # left, bottom, width, height of what is drawn above the caption
COMPRESSION = 3  # of 9: more takes half of a picture's time for a tenth of its size
INK = "#16191d"
_fronts = WeakKeyDictionary[Subject, bytes]()
_painted = WeakKeyDictionary[Subject, dict[tuple[str, bool], Any]]()


@contextmanager
def plain_figure(width: float, height: float) -> Iterator[Figure]:
    """Make a white figure of a size in inches, without pyplot's global state."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(
        {"font.family": "DejaVu Sans", "font.size": 9, "text.color": INK, "axes.labelcolor": INK}
    ):
        yield Figure(figsize=(width, height), facecolor="white")


def png(figure: Figure, dpi: int = 130) -> bytes:
    """Return the figure as PNG, equal for equal figures."""
    buffer = io.BytesIO()
    quick = {"compress_level": COMPRESSION}
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": "o3dls"}, pil_kwargs=quick)
    return buffer.getvalue()


def pictures_png(subject: Subject, *, behind: bool = False) -> bytes:
    """Draw the estimates side by side, coloured by the most telling field, in the first of the views or from
    behind.
    """
    with side_by_side(subject) as figure:
        draw_pictures(figure, subject, WHOLE, behind=behind)
        draw_caption(figure, caption(subject, behind=behind))
        return png(figure)


def front_png(subject: Subject) -> bytes:
    """Draw the estimates from the front, once for a subject: page and slides share the picture."""
    if subject not in _fronts:
        _fronts[subject] = pictures_png(subject)
    return _fronts[subject]


def side_by_side(subject: Subject) -> AbstractContextManager[Figure]:
    """Make a figure as wide as the estimates that are shown."""
    return plain_figure(3.6 * len(subject.shown) + 0.6, 4.5)


def draw_caption(figure: Figure, text: str) -> None:
    """Write the caption of a picture at its lower edge, as small as it must be to stand there whole."""
    line = figure.text(0.02, 0.012, drawable(text, 200), fontsize=7.5, parse_math=False)
    shrunk(line, 0.96 * figure.bbox.width)


def draw_pictures(
    figure: Figure, subject: Subject, box: tuple[float, float, float, float], *, behind: bool = False
) -> None:
    """Draw the side-by-side pictures with their colour bar into a part (left, bottom, width, height) of a
    figure.
    """
    surfaces = list(subject.surfaces.values())
    field = known_fields(surfaces, subject.unit)[0]
    left, bottom, width, height = box
    each = width / len(surfaces)
    view = _fitting_view(surfaces, orientation(subject).looking(behind=behind))
    for k, (name, surface) in enumerate(zip(subject.shown, surfaces, strict=True)):
        axes = figure.add_axes((left + k * each, bottom + 0.16 * height, each, 0.76 * height))
        pictures = _painted.setdefault(subject, {})  # page and slides share the pictures, at different sizes
        if (name, behind) not in pictures:
            pictures[name, behind] = _draw_picture(subject, name, surface, field, view)
        axes.imshow(pictures[name, behind], interpolation="antialiased")
        shrunk(axes.set_title(drawable(name), fontsize=11, parse_math=False), axes.bbox.width)
        axes.set_axis_off()
    values = [surface.fields[field.key] for surface in surfaces if field.key in surface.fields]
    at = (left + 0.04 * width, bottom + 0.11 * height, 0.42 * width, 0.03 * height)
    draw_bar(figure, field, at, values)
    gaps = [subject.results[name].point_distances for name in subject.shown]
    at = (left + 0.54 * width, bottom + 0.11 * height, 0.42 * width, 0.03 * height)
    draw_bar(figure, point_field(subject), at, gaps)


def _fitting_view(surfaces: Sequence[Surface], axes: Array) -> View:
    """Find the view along axes in which all surfaces just fit."""
    from .raster import View

    flat = np.vstack([surface.vertices for surface in surfaces]) @ axes.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    width, height = (high - low)[:2]
    return View(axes, (low + high) / 2 @ axes, MARGIN * max(height, width * PIXELS[1] / PIXELS[0]))


def _draw_picture(subject: Subject, name: str, surface: Surface, field: Field, view: View) -> Any:
    """Draw one picture: the surface in the colours of a field, the points in those of their distance."""
    from .raster import Canvas

    canvas = Canvas(view, *PIXELS, (1, 1, 1))
    values = surface.fields.get(field.key, np.full(len(surface.vertices), np.nan))
    canvas.surface(surface, colours_of(values, field))
    result = subject.results[name]
    points = result.drawn_points
    canvas.balls(
        points.xyz,
        colours_of(result.point_distances, point_field(subject)),
        1.0 if len(points) < 2000 else 0.5,
    )
    return canvas.pixels()


def draw_bar(
    figure: Figure, field: Field, box: tuple[float, float, float, float], values: Sequence[Array]
) -> None:
    """Draw the colours of a field with numbers, name and unit, pointed at an end beyond which there are
    values.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    colours = ScalarMappable(Normalize(field.low, field.high), ListedColormap(colour_table(field.colours)))
    axes = figure.add_axes(box)
    extend = field.extended(np.concatenate(values))
    bar = figure.colorbar(colours, cax=axes, orientation="horizontal", extend=extend, extendfrac=0.03)
    name = f"{field.label}, {field.unit}" if field.unit else field.label
    axes.set_xlabel(name, fontsize=9, parse_math=False)
    axes.tick_params(labelsize=8)
    bar.outline.set_linewidth(0.6)


def shrunk(text: Text, width: float) -> None:
    """Make a text smaller where it is wider than so many pixels."""
    text.set_fontsize(float(text.get_fontsize()) * min(1.0, width / text.get_window_extent().width))


def drawable(text: str, longest: int = 32) -> str:
    """Return the text as the figures' font can draw it: other letters become a box, and what is too long is
    cut in the middle.
    """
    known = _known_letters()
    cut = text if len(text) <= longest else f"{text[: (longest - 1) // 2]}…{text[-(longest // 2) :]}"
    return "".join(letter if ord(letter) in known else "□" for letter in cut)


@cache
def _known_letters() -> frozenset[int]:
    from matplotlib.font_manager import findfont, get_font

    return frozenset(get_font(findfont("DejaVu Sans")).get_charmap())
