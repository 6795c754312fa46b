"""Twelve slices through the image along each of the patient's axes: where they lie, their grey values, and
where they meet the surfaces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...evaluation.distances import distances
from ..drawing.slices import PLANES, Frame, slice_surface
from .brought import Brought

ORDER = ("axial", "coronal", "sagittal")
COUNT = 12  # slices of a stack
BESIDE = 2.0  # mm beside a slice within which points are drawn
MARGIN = 12.0  # mm around what is drawn
INSET = 0.03  # of the extent along which slices lie, at either end: a slice there meets next to nothing
BINS = 120  # along an axis, in which differences and points are counted
PIXELS = 280  # along the longer side of a picture
RANGE = (0.1, 99.9)  # percentiles of grey values that the pictures keep
WINDOW = (1.0, 99.8)  # percentiles that are black and white at first: late enhancement is of few pixels
Grey = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Cut:
    """A cut is one slice: its level along the axis, pixels (rows, columns), the segments (n, 2, 2) of each
    layer by its key, and the points (k, 2) beside it, right and up in mm.
    """

    level: float
    pixels: Grey
    outlines: Mapping[str, Array]
    points: Array


@dataclass(frozen=True, eq=False)
class Stack:
    """A stack has slices across one axis: `axes` (3, 3) has right, up and across as rows, in the frame of the
    prior.
    """

    plane: str
    axis: str
    sign: float
    axes: Array
    frame: Frame
    cuts: tuple[Cut, ...]

    def title(self, *, patient: bool) -> str:
        """Return the name of the plane, which is one of the patient's where these are known."""
        return self.plane if patient else f"across the image's {self.axis} axis"

    def place(self, cut: Cut) -> float:
        """Return where a slice lies along the axis of the image's frame, in mm."""
        return cut.level * self.sign

    def name(self, cut: Cut) -> str:
        """Return the place of a slice, and how many points are beside it."""
        count = f"{len(cut.points)} point{'' if len(cut.points) == 1 else 's'}"
        return f"{self.axis} = {self.place(cut):.1f} mm, {count} within {BESIDE:g} mm"


@dataclass(frozen=True, eq=False)
class Stacks:
    """This holds the stacks of a run, with the grey values (low, high) that their pixels 0 and 255 stand for,
    and those that are black and white at first.
    """

    stacks: tuple[Stack, ...]
    range: tuple[float, float]
    window: tuple[float, float]


def make_stacks(brought: Brought) -> Stacks:
    """Cut the image and what was brought back to it. Raises InputError where the image cannot be read."""
    directions = np.array([brought.seen.left, brought.seen.front, brought.seen.up])
    everything = np.vstack([layer.surface.vertices for layer in brought.layers])
    planned = []
    for plane in ORDER:
        across, right, up = PLANES[plane]
        axes = directions[[right, up, across]]
        planned.append((plane, across, axes, _choose_levels(brought, axes[2])))
    frames = _make_frames([axes for _, _, axes, _ in planned], everything, brought)
    grids = [
        _pixel_places(axes, levels, frame)
        for (_, _, axes, levels), frame in zip(planned, frames, strict=True)
    ]
    part = brought.image.around(np.vstack([grid.reshape(-1, 3)[_corners(grid)] for grid in grids]))
    values = [part.sample(grid, nearest=brought.labels) for grid in grids]
    low, high, window = _grey_range(np.concatenate([one[np.isfinite(one)] for one in values]), brought.labels)
    stacks = []
    for (plane, across, axes, levels), frame, one in zip(planned, frames, values, strict=True):
        cuts = _make_cuts(brought, axes, levels, _as_bytes(one, low, high))
        stacks.append(Stack(plane, "xyz"[across], directions[across, across], axes, frame, cuts))
    return Stacks(tuple(stacks), (low, high), window)


def _choose_levels(brought: Brought, across: Array) -> Array:
    """Choose levels (COUNT,) along an axis: a third of their density is even, a third goes where the result
    differs from the prior, and a third where points lie.
    """
    result = brought.result
    along = result.vertices @ across
    ends = np.concatenate([along, brought.prior.vertices @ across])
    low, high = ends.min(), ends.max()
    low, high = low + INSET * (high - low), high - INSET * (high - low)
    edges = np.linspace(low, high, BINS + 1)
    gaps = distances(result.vertices, brought.prior) * result.vertex_areas
    shares = [np.full(BINS, 1.0 / BINS)]
    for at, weights in ((along, gaps), (brought.points @ across, None)):
        counted = np.histogram(at, edges, weights=weights)[0]
        if counted.sum() > 0.0:
            shares.append(counted / counted.sum())
    below = np.concatenate([[0.0], np.cumsum(np.mean(shares, axis=0))])
    return np.interp((np.arange(COUNT) + 0.5) / COUNT, below / below[-1], edges)


def _make_frames(axes: Sequence[Array], everything: Array, brought: Brought) -> list[Frame]:
    """Make a frame for each plane, all of one size, so of one scale, around all that is drawn."""
    names = brought.seen.sides()
    lows = [(everything @ one[:2].T).min(axis=0) for one in axes]
    highs = [(everything @ one[:2].T).max(axis=0) for one in axes]
    half = np.max([(high - low) / 2 for low, high in zip(lows, highs, strict=True)], axis=0) + MARGIN
    frames = []
    for plane, low, high in zip(ORDER, lows, highs, strict=True):
        _, right, up = PLANES[plane]
        middle = (low + high) / 2
        sides = (names[right][1], names[right][0], names[up][1], names[up][0])
        frames.append(Frame(middle - half, middle + half, "mm", sides))
    return frames


def _pixel_places(axes: Array, levels: Array, frame: Frame) -> Array:
    """Return the centres (levels, rows, columns, 3) of pixels, the first row above."""
    extent = frame.high - frame.low
    columns, rows = np.maximum(np.round(PIXELS * extent / extent.max()), 1).astype(int)
    right = frame.low[0] + (np.arange(columns) + 0.5) * extent[0] / columns
    up = frame.high[1] - (np.arange(rows) + 0.5) * extent[1] / rows
    level, row, column = np.meshgrid(levels, up, right, indexing="ij")
    return np.asarray(np.stack([column, row, level], axis=-1) @ axes)


def _corners(grid: Array) -> NDArray[np.int64]:
    """Return the rows, in a flat grid, of the corners of its first and its last slice."""
    levels, rows, columns = (np.array([0, n - 1]) for n in grid.shape[:3])
    found = np.stack(np.meshgrid(levels, rows, columns, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(np.ravel_multi_index(tuple(found.T), grid.shape[:3]))


def _grey_range(values: Array, labels: bool) -> tuple[float, float, tuple[float, float]]:
    """Return the least and the largest grey value that pictures keep, and those that are black and white at
    first.
    """
    low, high = np.percentile(values, (0.0, 100.0) if labels else RANGE).tolist()
    window = np.percentile(values, (0.0, 100.0) if labels else WINDOW).tolist()
    high = high if high > low else low + 1.0
    return low, high, (window[0], window[1]) if window[1] > window[0] else (low, high)


def _as_bytes(values: Array, low: float, high: float) -> Grey:
    """Return grey values as bytes; what lies outside of the image is black."""
    shares = np.nan_to_num((values - low) / (high - low), nan=0.0)
    return np.round(255.0 * np.clip(shares, 0.0, 1.0)).astype(np.uint8)


def _make_cuts(brought: Brought, axes: Array, levels: Array, pixels: Grey) -> tuple[Cut, ...]:
    surfaces = {layer.key: layer.surface for layer in brought.layers}
    flat = {key: replace(one, vertices=one.vertices @ axes.T) for key, one in surfaces.items()}
    points = brought.points @ axes.T
    return tuple(
        Cut(
            float(level),
            pixels[k],
            {key: slice_surface(surface, 2, float(level)) for key, surface in flat.items()},
            points[np.abs(points[:, 2] - level) < BESIDE, :2],
        )
        for k, level in enumerate(levels)
    )
