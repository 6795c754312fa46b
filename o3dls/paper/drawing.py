"""Drawings that several experiments share: curves with spread, outlines, rendered surfaces on one colour
scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..geometry.surface import Surface
from ..report.drawing.colour_maps import colour_table
from ..report.drawing.fields import Field
from ..report.drawing.figures import plain_figure, png
from ..report.palette import colour_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# the report's colours; each method also has a marker of its own
COLOURS = {method: colour_of(method) for method in ("icp", "similarity", "deform", "level_set", "paper")}
COLOURS |= {"static": COLOURS["icp"], "phases": COLOURS["level_set"], "truth": "#8a8f98"}
MARKERS = {
    "static": "s",
    "phases": "o",
    "icp": "s",
    "similarity": "^",
    "deform": "v",
    "level_set": "o",
    "paper": "D",
}
NAMES = {
    "start": "template",
    "landmarks": "landmarks",
    "icp": "ICP, rigid",
    "similarity": "ICP, similarity",
    "deform": "motion T",
    "level_set": "level set (ours)",
    "static": "static template",
    "phases": "temporal template",
    "paper": "equation 16",
    "truth": "truth",
}
INCH = 2.6
BONE = (0.87, 0.85, 0.80)

Curve = Mapping[float, Array]  # samples (k,) by position on the axis


def curves(
    panels: Mapping[str, Mapping[str, Curve]], x: str, y: str, lines: Mapping[str, Curve] | None = None
) -> bytes:
    """Draw panels side by side on one scale: mean over seeds per method, with one standard deviation; `lines`
    are dashed in the first panel.
    """
    with plain_figure(3.6 * len(panels), 3.3) as figure:
        axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for ax, (title, methods) in zip(axes, panels.items(), strict=True):
            for k, (method, curve) in enumerate(methods.items()):
                _draw_spread(ax, method, curve, k - (len(methods) - 1) / 2)
            ax.set_title(title)
            ax.set_xlabel(x)
            ax.grid(alpha=0.25)
            ax.xaxis.get_major_locator().set_params(integer=True)
            if len(at := {level for curve in methods.values() for level in curve}) == 1:
                ax.set_xlim(min(at) - 1, min(at) + 1)  # one level: methods stand beside each other
        axes[0].set_ylim(0.0, 1.05 * axes[0].get_ylim()[1])
        axes[0].set_ylabel(y)
        for name, curve in (lines or {}).items():
            axes[0].plot(
                list(curve),
                [v.mean() for v in curve.values()],
                "--",
                color=COLOURS["truth"],
                label=name,
                zorder=1,
            )
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, fontsize=8, loc="upper center", ncols=len(labels))
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.92))
        return png(figure)


def _draw_spread(ax: Axes, method: str, curve: Curve, offset: float) -> None:
    """Draw a curve with bars, moved a little sideways so that bars do not hide each other."""
    at = np.array(list(curve))
    step = np.ptp(at) / max(len(at) - 1, 1) if len(at) > 1 else 1.0
    mean, sd = (np.array([f(v) for v in curve.values()]) for f in (np.mean, np.std))
    ax.errorbar(
        at + 0.04 * step * offset,
        mean,
        sd,
        color=COLOURS[method],
        marker=MARKERS[method],
        markersize=5,
        capsize=3,
        label=NAMES[method],
    )


def outlines(panels: Sequence[tuple[str, Mapping[str, Surface], Array]], columns: int) -> bytes:
    """Draw 2D outlines by method with points, one frame for all panels."""
    rows = -(-len(panels) // columns)
    low, high = (
        f([f(s.vertices, axis=0) for _, shapes, _ in panels for s in shapes.values()], axis=0)
        for f in (np.min, np.max)
    )
    with plain_figure(INCH * columns, INCH * rows) as figure:
        grid = figure.subplots(rows, columns, squeeze=False)
        for ax in grid.ravel():
            ax.set_axis_off()
        for ax, (title, shapes, points) in zip(grid.ravel(), panels, strict=False):
            for method, shape in shapes.items():
                _draw_outline(ax, shape, COLOURS.get(method, "#000000"), 1.2 if method == "truth" else 1.6)
            ax.plot(*points.T, ".", color="black", markersize=4)
            ax.set(
                title=title, xlim=(low[0] - 5, high[0] + 5), ylim=(low[1] - 5, high[1] + 5), aspect="equal"
            )
        figure.tight_layout(pad=0.4)
        return png(figure)


def _draw_outline(ax: Axes, shape: Surface, colour: str, width: float) -> None:
    from matplotlib.collections import LineCollection

    ax.add_collection(LineCollection(list(shape.vertices[shape.faces]), colors=colour, linewidths=width))


def rendered(panels: Sequence[Sequence[tuple[str, Surface, Array]]], axes: Array, scale: Field) -> bytes:
    """Draw rows of rendered surfaces with points, coloured by `scale.key`, one scale for all; surfaces
    without that field are bone.
    """
    from ..report.drawing.painting import paint_field, plain
    from ..report.drawing.raster import Canvas, View

    everything = np.vstack([surface.vertices for row in panels for _, surface, _ in row])
    flat = everything @ axes.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    width, height = (high - low)[:2] * 1.06
    view = View(axes, (low + high) / 2 @ axes, float(height))
    pixels = (int(360 * width / height), 360)
    columns = max(map(len, panels))
    with plain_figure(max(2.4 * columns * width / height, 3.6), 2.65 * len(panels) + 0.7) as figure:
        bottom = 0.7 / (2.65 * len(panels) + 0.7)
        grid = figure.subplots(len(panels), columns, squeeze=False)
        figure.subplots_adjust(left=0.01, right=0.99, top=0.95, bottom=bottom, wspace=0.02, hspace=0.14)
        for ax in grid.ravel():
            ax.set_axis_off()
        for row, drawn in zip(grid, panels, strict=True):
            for ax, (title, surface, seen) in zip(row, drawn, strict=False):
                canvas = Canvas(view, *pixels, (1, 1, 1))
                canvas.surface(
                    surface, paint_field(surface, scale) if scale.key in surface.fields else plain(BONE)
                )
                canvas.balls(seen, np.tile([0.1, 0.1, 0.1], (len(seen), 1)), 0.8)
                ax.imshow(canvas.pixels(), interpolation="antialiased")
                ax.set_title(title, fontsize=9)
        _draw_bar(figure, scale, bottom)
        return png(figure)


def _draw_bar(figure: Any, scale: Field, bottom: float) -> None:
    ax = figure.add_axes((0.2, 0.62 * bottom, 0.6, 0.16 * bottom))
    ax.imshow(colour_table(scale.colours)[None], aspect="auto", extent=(scale.low, scale.high, 0, 1))
    ax.set_yticks([])
    ax.set_xlabel(f"{scale.label}, {scale.unit}", fontsize=9, labelpad=1)
    ax.tick_params(labelsize=8)
