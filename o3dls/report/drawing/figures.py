"""Figures for paper and slides, by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ...arrays import Array
from ..subject import Subject
from .caption import caption
from .colour_maps import colour_table
from .fields import Field, point_field, shown_fields
from .pictures import COMPRESSION, pictures

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Text

WHOLE = (0.02, 0.03, 0.96, 0.95)  # left, bottom, width, height of what is drawn above the caption
INK = "#16191d"


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
    field = shown_fields(subject)[0]
    left, bottom, width, height = box
    each = width / len(surfaces)
    for k, (name, pixels) in enumerate(pictures(subject, behind=behind).items()):
        axes = figure.add_axes((left + k * each, bottom + 0.16 * height, each, 0.76 * height))
        axes.imshow(pixels, interpolation="antialiased")
        shrunk(axes.set_title(drawable(name), fontsize=11, parse_math=False), axes.bbox.width)
        axes.set_axis_off()
    values = [surface.fields[field.key] for surface in surfaces if field.key in surface.fields]
    at = (left + 0.04 * width, bottom + 0.11 * height, 0.42 * width, 0.03 * height)
    draw_bar(figure, field, at, values)
    gaps = [subject.results[name].point_distances for name in subject.shown]
    at = (left + 0.54 * width, bottom + 0.11 * height, 0.42 * width, 0.03 * height)
    draw_bar(figure, point_field(subject), at, gaps)


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
