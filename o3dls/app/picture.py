"""A small picture of what was read, drawn without a browser or a graphics card."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..arrays import Array
    from ..case import Points
    from ..geometry.surface import Surface

PIXELS = (420, 330)
MARGIN = 1.12
GREYS = (0.01, 0.99)  # quantiles that are black and white
FACES = 20_000  # more are not seen
WALL = (0.62, 0.68, 0.76)
COLOURS = {"eam": (0.75, 0.31, 0.0), "landmark": (0.64, 0.28, 0.49), "ablation": (0.1, 0.1, 0.12)}
OTHERS = (0.42, 0.42, 0.0)
# rows: right, up and towards the viewer, who stands in front of the patient
FRONT = {"RAS": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))}
FRONT_LPS = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))


def draw(space: str, *, surface: Surface | None = None, points: Points | None = None) -> str | None:
    """Draw a surface and points from the front, as the base64 text of a PNG; None where there is nothing."""
    from PIL import Image

    from ..report.drawing.painting import plain
    from ..report.drawing.raster import Canvas, View
    from ..report.surfaces.display import decimated

    parts = [surface.vertices] if surface is not None else []
    parts += [points.xyz] if points is not None else []
    if not sum(map(len, parts)) or parts[0].shape[1] != 3:
        return None
    axes = np.array(FRONT.get(space, FRONT_LPS))
    canvas = Canvas(View(axes, *_fit_view(np.vstack(parts) @ axes.T, axes)), *PIXELS, (1, 1, 1))
    if surface is not None:
        drawn = decimated(surface, FACES, FACES)
        canvas.surface(drawn, plain(WALL))
    if points is not None:
        colours = np.array([COLOURS.get(str(kind), OTHERS) for kind in points.type]).reshape(-1, 3)
        canvas.balls(points.xyz, colours, 1.0 if len(points) < 2000 else 0.5)
    return _encode_png(Image.fromarray(canvas.pixels()))


def draw_slice(values: Array, spacing: tuple[float, float]) -> str:
    """Draw a slice (rows, columns) of an image in grey, as the base64 text of a PNG; spacing: mm from row to
    row, and from column to column.
    """
    from PIL import Image

    low, high = np.quantile(values, GREYS)
    grey = np.clip((values - low) / max(float(high - low), 1e-12), 0.0, 1.0)
    rows, columns = values.shape[0] * spacing[0], values.shape[1] * spacing[1]
    scale = min(PIXELS[0] / columns, PIXELS[1] / rows)
    size = max(1, round(columns * scale)), max(1, round(rows * scale))
    picture = Image.fromarray(np.round(255.0 * grey).astype(np.uint8)).resize(size)
    return _encode_png(picture)


def _encode_png(picture: Any) -> str:
    buffer = io.BytesIO()
    picture.save(buffer, format="png")
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def _fit_view(flat: Array, axes: Array) -> tuple[Array, float]:
    """Return the centre and the height of a view in which all places, along its axes, just fit."""
    low, high = flat.min(axis=0), flat.max(axis=0)
    width, height = (high - low)[:2]
    return (low + high) / 2 @ axes, MARGIN * max(float(height), float(width) * PIXELS[1] / PIXELS[0], 1.0)
