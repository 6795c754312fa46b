"""Pictures of surfaces without a graphics card or a screen: a small z-buffer renderer, equal on every
machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from ...arrays import Array, Ints, Mask
from ...geometry.surface import Surface

SUPERSAMPLING = 2
FLOOR, INSIDE = 0.85, 0.93  # of the light, and of that on the inner side: colours are read by their lightness
STRIP = 32  # rows of the fine grid that are painted at once
HATCH = 14  # pixels of the fine grid from line to line
RIM = 0.76  # of a ball's radius, beyond which it is white: it stands out on a wall of its own colour


@dataclass(frozen=True)
class View:
    """A view is an orthographic camera: rows of `axes` are right, up and towards the viewer; `centre` is in
    the middle, `height` mm fit the picture.
    """

    axes: Array
    centre: Array
    height: float

    def project(self, points: Array) -> Array:
        """Return right, up and depth (larger is nearer) in mm about the centre, (n, 3)."""
        return np.asarray((points - self.centre) @ self.axes.T)


@dataclass(frozen=True, eq=False)
class Pixels:
    """Pixels are the m in which a surface is seen: each has the corners (m, 3) of its triangle and the
    weights (m, 3) of these, and whether lines of a hatching (m,) are there.
    """

    corners: Ints
    weights: Array
    striped: Mask

    def read(self, values: Array) -> Array:
        """Return values (n,) or (n, k) of the vertices as they are in the pixels, (m,) or (m, k)."""
        columns = np.ascontiguousarray(values, dtype=np.float64).reshape(len(values), -1)
        return np.asarray(_read(self.corners, self.weights, columns)).reshape(-1, *values.shape[1:])


class Canvas:
    """A canvas is a picture with depth: draw surfaces and balls into it in any order, then take the
    pixels.
    """

    def __init__(self, view: View, width: int, height: int, background: tuple[float, float, float]) -> None:
        self.view = view
        shape = (height * SUPERSAMPLING, width * SUPERSAMPLING)
        self._colour = np.full((*shape, 3), background, dtype=np.float32)
        self._depth = np.full(shape, -np.inf, dtype=np.float32)
        self._scale = shape[0] / view.height

    def _place_on_grid(self, points: Array) -> Array:
        """Return the column, row (pixels of the fine grid) and depth (mm), (n, 3)."""
        flat = self.view.project(points)
        rows, columns = self._depth.shape
        return np.column_stack(
            [columns / 2 + flat[:, 0] * self._scale, rows / 2 - flat[:, 1] * self._scale, flat[:, 2]]
        )

    def surface(self, surface: Surface, paint: Callable[[Pixels], Array]) -> None:
        """Draw a surface; `paint` gives the colours (m, 3) in [0, 1] of the pixels in which it is seen."""
        facing = surface.vertex_normals @ self.view.axes[2]
        corners = self._place_on_grid(surface.vertices)
        face = np.full(self._depth.shape, -1, dtype=np.int32)
        _draw_triangles(corners, surface.faces, face, self._depth)
        # strip by strip: new memory for all pixels at once costs more than what is done with it
        for top in range(0, len(face), STRIP):
            rows, columns = np.nonzero(face[top : top + STRIP] >= 0)
            rows += top
            seen = surface.faces[face[rows, columns]]
            weights, light = _weigh_corners(corners, seen, facing, rows, columns)
            striped = (rows + columns) % HATCH < 0.4 * HATCH
            self._colour[rows, columns] = light[:, None] * paint(Pixels(seen, weights, striped))

    def balls(self, centres: Array, colours: Array, radius: float) -> None:
        """Draw shaded balls of a radius in mm with white rims, colours (n, 3)."""
        _draw_balls(
            self._place_on_grid(centres),
            np.asarray(colours, dtype=np.float64),
            radius,
            self._scale,
            self._colour,
            self._depth,
        )

    def pixels(self) -> Any:
        """Return the picture, (height, width, 3) bytes."""
        steps = range(SUPERSAMPLING)
        # a sum of slices takes a fifth of the time of a mean over two axes
        mean = sum(self._colour[i::SUPERSAMPLING, j::SUPERSAMPLING] for i in steps for j in steps)
        return np.round(255 * np.clip(mean / SUPERSAMPLING**2, 0, 1)).astype(np.uint8)


@njit(cache=True, inline="always")
def _twice_area(a, b, c):  # type: ignore[no-untyped-def]
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@njit(cache=True, inline="always")
def _weights_at(a, b, c, x, y):  # type: ignore[no-untyped-def]
    area = _twice_area(a, b, c)
    u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
    v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
    return u, v


@njit(cache=True, nogil=True)
def _read(corners, weights, values):  # type: ignore[no-untyped-def]
    found = np.empty((len(corners), values.shape[1]))
    for m in range(len(corners)):
        a, b, c = corners[m]
        for k in range(values.shape[1]):
            found[m, k] = (
                weights[m, 0] * values[a, k] + weights[m, 1] * values[b, k] + weights[m, 2] * values[c, k]
            )
    return found


@njit(cache=True, nogil=True)
def _draw_triangles(corners, faces, face, depth):  # type: ignore[no-untyped-def]
    rows, columns = depth.shape
    for f in range(len(faces)):
        a, b, c = corners[faces[f, 0]], corners[faces[f, 1]], corners[faces[f, 2]]
        if _twice_area(a, b, c) == 0.0:
            continue
        for y in range(
            max(0, int(np.ceil(min(a[1], b[1], c[1])))),
            min(rows - 1, int(np.floor(max(a[1], b[1], c[1])))) + 1,
        ):
            for x in range(
                max(0, int(np.ceil(min(a[0], b[0], c[0])))),
                min(columns - 1, int(np.floor(max(a[0], b[0], c[0])))) + 1,
            ):
                u, v = _weights_at(a, b, c, x, y)
                w = 1.0 - u - v
                z = u * a[2] + v * b[2] + w * c[2]
                if u < 0.0 or v < 0.0 or w < 0.0 or z <= depth[y, x]:
                    continue
                depth[y, x] = z
                face[y, x] = f


@njit(cache=True, nogil=True)
def _weigh_corners(corners, seen, facing, rows, columns):  # type: ignore[no-untyped-def]
    weights, light = np.empty((len(seen), 3)), np.empty(len(seen))
    for m in range(len(seen)):
        i, j, k = seen[m]
        a, b, c = corners[i], corners[j], corners[k]
        u, v = _weights_at(a, b, c, columns[m], rows[m])
        w = 1.0 - u - v
        towards = u * facing[i] + v * facing[j] + w * facing[k]
        # rows count down, so a positive area is a face seen from inside
        most = 1.0 if _twice_area(a, b, c) < 0.0 else INSIDE
        weights[m, 0], weights[m, 1], weights[m, 2] = u, v, w
        light[m] = most - (most - FLOOR) * (1.0 - min(1.0, abs(towards))) ** 2
    return weights, light


@njit(cache=True, nogil=True)
def _draw_balls(centres, colours, radius, scale, picture, depth):  # type: ignore[no-untyped-def]
    rows, columns = depth.shape
    reach = radius * scale
    for i in range(len(centres)):
        cx, cy, cz = centres[i]
        for y in range(max(0, int(np.ceil(cy - reach))), min(rows - 1, int(np.floor(cy + reach))) + 1):
            for x in range(max(0, int(np.ceil(cx - reach))), min(columns - 1, int(np.floor(cx + reach))) + 1):
                rest = 1.0 - ((x - cx) ** 2 + (y - cy) ** 2) / reach**2
                if rest < 0.0 or cz + radius * np.sqrt(rest) <= depth[y, x]:
                    continue
                depth[y, x] = cz + radius * np.sqrt(rest)
                for k in range(3):
                    shade = (0.45 + 0.55 * np.sqrt(rest)) * colours[i, k]
                    picture[y, x, k] = shade if rest > 1.0 - RIM**2 else 1.0
