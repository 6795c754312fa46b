"""Pictures of the estimates without a graphics card, to one scale: the page has them for browsers without
WebGL, slides draw a frame around them.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from ...arrays import Array
from ...geometry.surface import Surface
from ..mapping.views import orientation
from ..markup import Html, tag
from ..page_parts import image
from ..subject import Subject
from .caption import caption, colour_bar, made, view_name
from .fields import Field, colours_of, known_fields, point_field, shown_fields
from .painting import paint_field

if TYPE_CHECKING:
    from .raster import View

PIXELS = (640, 500)  # width and height of one picture
MARGIN = 1.12
PART = (448, 350)  # of each of many pictures of one wall
THUMBNAIL = (160, 124)  # width and height of the picture of a run in a table of many
QUALITY = 60  # of 100: 3 kB a thumbnail
COMPRESSION = 3  # of 9: more takes half of a picture's time for a tenth of its size
_drawn = WeakKeyDictionary[Subject, dict[bool, dict[str, Any]]]()


def pictures(subject: Subject, *, behind: bool = False) -> dict[str, Any]:
    """Return a picture (height, width, 3), in bytes, of each estimate that is shown, from the first of the
    views or from behind, in the colours of the most telling field: drawn once for a subject, since page and
    slides have the same.
    """
    of_view = _drawn.setdefault(subject, {})
    if behind not in of_view:
        surfaces = list(subject.surfaces.values())
        field = shown_fields(subject)[0]
        view = _fitting_view(surfaces, orientation(subject).looking(behind=behind))
        of_view[behind] = {
            name: _draw_picture(subject, name, surface, field, view)
            for name, surface in zip(subject.shown, surfaces, strict=True)
        }
    return of_view[behind]


def static_pictures(subject: Subject) -> Html:
    """Place the pictures from the front into the page, side by side, with the scales of their colours."""
    surfaces = list(subject.surfaces.values())
    field = shown_fields(subject)[0]
    values = [surface.fields[field.key] for surface in surfaces if field.key in surface.fields]
    gaps = [subject.results[name].point_distances for name in subject.shown]
    row = [
        image(_png_of(pixels), f"{name}, from {view_name(subject)}", tag("figcaption", name))
        for name, pixels in pictures(subject).items()
    ]
    return tag(
        "div",
        tag("div", *row, class_="row"),
        tag("div", colour_bar(field, values), colour_bar(point_field(subject), gaps), class_="row"),
        tag("p", f"{caption(subject)}. View by the {orientation(subject).known_by}.", class_="soft"),
        class_="static",
    )


def wall_pictures(subject: Subject, surface: Surface, fields: Sequence[Field]) -> Html:
    """Place pictures of a surface in the map into the page, in the colours of each field from the front and
    from behind, with the scale of these.
    """
    rows = list[Html]()
    for field in fields:
        drawn = [_draw_wall(subject, surface, field, behind=behind) for behind in (False, True)]
        rows.append(tag("div", *drawn, class_="row"))
        rows.append(colour_bar(field, [surface.fields[field.key]]))
    return tag(
        "div", *rows, tag("p", f"{subject.case.name} · {made(subject)}.", class_="soft"), class_="static"
    )


def _draw_wall(subject: Subject, surface: Surface, field: Field, *, behind: bool) -> Html:
    from .raster import Canvas

    view = _fitting_view([surface], orientation(subject).looking(behind=behind))
    canvas = Canvas(view, *PART, (1, 1, 1))
    canvas.surface(surface, paint_field(surface, field))
    said = f"{field.label}, {view_name(subject, behind=behind)}"
    return image(_png_of(canvas.pixels()), f"{subject.last.name}: {said}", tag("figcaption", said))


def thumbnail(subject: Subject) -> bytes:
    """Draw the last estimate small, in the colours of the most telling field, as a file of WebP; empty in
    two dimensions.
    """
    from PIL import Image

    if subject.case.dimension == 2:
        return b""
    name, surface = subject.last.name, subject.surfaces[subject.last.name]
    field = known_fields([surface], subject.unit)[0]
    view = _fitting_view([surface], orientation(subject).looking())
    buffer = io.BytesIO()
    drawn = _draw_picture(subject, name, surface, field, view, THUMBNAIL)
    Image.fromarray(drawn).save(buffer, format="webp", quality=QUALITY)
    return buffer.getvalue()


def _png_of(pixels: Any) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="png", compress_level=COMPRESSION)
    return buffer.getvalue()


def _fitting_view(surfaces: Sequence[Surface], axes: Array) -> View:
    """Find the view along axes in which all surfaces just fit."""
    from .raster import View

    flat = np.vstack([surface.vertices for surface in surfaces]) @ axes.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    width, height = (high - low)[:2]
    return View(axes, (low + high) / 2 @ axes, MARGIN * max(height, width * PIXELS[1] / PIXELS[0]))


def _draw_picture(
    subject: Subject,
    name: str,
    surface: Surface,
    field: Field,
    view: View,
    pixels: tuple[int, int] = PIXELS,
) -> Any:
    """Draw one picture: the surface in the colours of a field, the points in those of their distance."""
    from .raster import Canvas

    canvas = Canvas(view, *pixels, (1, 1, 1))
    remoteness = surface.fields.get(f"distance_to_nearest_point_{subject.unit}")
    canvas.surface(surface, paint_field(surface, field, remoteness))
    result = subject.results[name]
    points = result.drawn_points
    canvas.balls(
        points.xyz,
        colours_of(result.point_distances, point_field(subject)),
        1.0 if len(points) < 2000 else 0.5,
    )
    return canvas.pixels()
