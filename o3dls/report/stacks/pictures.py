"""The stacks as PNG files, each slice with its contours, and a table of where the slices lie."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...arrays import Array
from ...io.atomic import write_file
from ...io.grey.of_case import log_gap
from ...io.manifest import noted
from ...io.table import write_table
from ...places import make_folder
from ...runs.image.values import with_named_image
from ..drawing.figures import drawable, plain_figure, png
from ..drawing.slices import write_path
from ..subject import read_subject
from ..surfaces.given import with_given
from .brought import Brought, brought_back
from .stack import Cut, Stack, Stacks, make_stacks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FOLDER = "slices"
WIDTH, ABOVE, BELOW = 5.0, 0.35, 0.75  # inches, of a picture, and of its title and legend
DPI = 160
UNITS = 100.0  # to 1 mm: lines are chained by places in tenths of a unit
# of a picture: left, right, below, above; each with how text is set there
EDGES = (
    (0.01, 0.5, "left", "center"),
    (0.99, 0.5, "right", "center"),
    (0.5, 0.01, "center", "bottom"),
    (0.5, 0.99, "center", "top"),
)
# colour, dashes and width of each layer, as static/stacks.css has them
LINES: Mapping[str, tuple[str, Any, float]] = {
    "prior": ("#ffdd57", "-", 2.6),
    "baseline": ("#ff9a6b", (0, (5, 2)), 1.4),
    "similar": ("#6fe38a", (0, (1.6, 1.6)), 1.4),
    "moved": ("#6cc7ff", "-", 1.4),
}


def write_slices(folder: str | Path, out: str | Path | None = None, image: str | Path | None = None) -> Path:
    """Write the slices of a finished run as pictures, and slices.csv, into `out`: by default the run's folder
    slices. `image`: the image of the prior, where it is not that of the run or stands elsewhere now.

    Raises InputError where the run has no image and none is given, or it cannot be drawn on.
    """
    folder = Path(folder)
    run = with_named_image(folder, image)
    brought = brought_back(read_subject([folder], runs=[with_given(run)]))
    log_gap(brought.image, run.case)
    stacks = make_stacks(brought)
    target = folder / FOLDER if out is None else Path(out)
    with noted(folder):
        _write_pictures(target, brought, stacks, within=folder if out is None else None)
    return target


def _write_pictures(target: Path, brought: Brought, stacks: Stacks, within: Path | None) -> None:
    make_folder(target)
    rows = [
        (f"{stack.plane}_{k:02d}.png", stack, cut)
        for stack in stacks.stacks
        for k, cut in enumerate(stack.cuts, 1)
    ]
    for name, stack, cut in rows:
        write_file(target / name, _draw(brought, stacks, stack, cut), within=within)
    table = {
        "file": np.array([name for name, _, _ in rows]),
        "plane": np.array([stack.title(patient=brought.seen.patient) for _, stack, _ in rows]),
        "axis": np.array([stack.axis for _, stack, _ in rows]),
        "place_mm": np.array([stack.place(cut) for _, stack, cut in rows]),
        "points": np.array([len(cut.points) for _, _, cut in rows]),
    }
    write_table(target / "slices.csv", table)


def _draw(brought: Brought, stacks: Stacks, stack: Stack, cut: Cut) -> bytes:
    """Draw one slice as PNG: grey values by the window, contours, points and the patient's directions."""
    frame = stack.frame
    extent = frame.high - frame.low
    tall = float(WIDTH * extent[1] / extent[0])
    height = ABOVE + tall + BELOW
    with plain_figure(WIDTH, height) as figure:
        axes = figure.add_axes((0.0, BELOW / height, 1.0, tall / height))
        share = [(value - stacks.range[0]) / (stacks.range[1] - stacks.range[0]) for value in stacks.window]
        axes.imshow(
            cut.pixels,
            cmap="gray",
            vmin=255.0 * share[0],
            vmax=255.0 * share[1],
            extent=(frame.low[0], frame.high[0], frame.low[1], frame.high[1]),
            interpolation="bilinear",
        )
        _draw_lines(axes, brought, cut)
        axes.set_xlim(frame.low[0], frame.high[0])
        axes.set_ylim(frame.low[1], frame.high[1])
        axes.set_axis_off()
        _name_sides(axes, stack)
        title = f"{stack.title(patient=brought.seen.patient)}, {stack.name(cut)}"
        axes.set_title(title, fontsize=10, parse_math=False)
        figure.legend(loc="lower center", ncols=2, fontsize=7, facecolor="#202020", labelcolor="white")
        return png(figure, DPI)


def _draw_lines(axes: Axes, brought: Brought, cut: Cut) -> None:
    from matplotlib.collections import LineCollection

    for layer in brought.layers:
        colour, dashes, width = LINES[layer.key]
        style: dict[str, Any] = {"linestyle": dashes, "linewidth": width, "color": colour}
        axes.add_collection(LineCollection(_chain(cut.outlines[layer.key]), **style))
        axes.plot([], [], label=drawable(layer.name, 48), **style)
    if len(cut.points):
        dots: dict[str, Any] = {"c": "white", "edgecolors": "black", "linewidths": 0.7, "zorder": 3}
        axes.scatter(cut.points[:, 0], cut.points[:, 1], s=14, label="points", **dots)


def _chain(segments: Array) -> list[Array]:
    """Return segments (n, 2, 2) as few long lines (k, 2), so that dashes show."""
    lines = write_path(UNITS * segments).split("M")[1:]
    return [
        np.array([place.split() for place in line.split("L")], dtype=np.float64) / UNITS for line in lines
    ]


def _name_sides(axes: Axes, stack: Stack) -> None:
    """Write what lies to the left, to the right, below and above at the edges of the picture."""
    for (x, y, across, along), name in zip(EDGES, stack.frame.sides or (), strict=False):
        axes.text(x, y, name, transform=axes.transAxes, ha=across, va=along, color="white", fontsize=9)
