"""Draw the picture at the top of docs/method.md: a cross-section of the demo's atrium, stage by stage.

python tools/method_pictures.py RUN docs        # RUN: the folder that the demo wrote
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection

from o3dls import Run, Surface, read_run
from o3dls.report.drawing.slices import slice_surface
from o3dls.report.palette import colour_of

BESIDE = 3.0  # mm beside the plane within which points are drawn
ACROSS = 1  # the axis that the plane stands across
TITLES = {
    "start": "1. The case",
    "icp": "2. Pose: landmarks, then ICP",
    "deform": "3. Motion T of the prior",
    "level_set": "4. Level set φ",
}
FLAT = [axis for axis in range(3) if axis != ACROSS]


def outline(axes: plt.Axes, surface: Surface, level: float, colour: str, *, truth: bool = False) -> None:
    """Where a surface meets the plane."""
    style = {"linestyle": (0, (2, 2)), "linewidth": 1.0} if truth else {"linewidth": 1.8}
    axes.add_collection(LineCollection(list(slice_surface(surface, ACROSS, level)), colors=colour, **style))


def band(axes: plt.Axes, surface: Surface, level: float, colour: str) -> None:
    """Two standard deviations to either side of the wall."""
    reach = 2.0 * surface.fields["sd_mm"][:, None] * surface.vertex_normals
    inner, outer = (
        slice_surface(surface.with_vertices(surface.vertices + s * reach), ACROSS, level) for s in (-1, 1)
    )
    for lines in (inner, outer):
        axes.add_collection(LineCollection(list(lines), colors=colour, linewidth=0.6, alpha=0.8))


def drawn(run: Run) -> plt.Figure:
    """The stages of a run whose case has a truth, from left to right."""
    truth = run.case.truth.surface
    level = float((truth.vertices[:, ACROSS].min() + truth.vertices[:, ACROSS].max()) / 2.0)
    points = run.case.points.of("eam").xyz
    near = points[np.abs(points[:, ACROSS] - level) < BESIDE][:, FLAT]
    figure, all_axes = plt.subplots(1, 4, figsize=(12, 3.4), sharex=True, sharey=True)
    for axes, (name, title) in zip(all_axes, TITLES.items(), strict=True):
        surface = run.estimates[name].surface
        outline(axes, truth, level, "#333333", truth=True)
        outline(axes, surface, level, colour_of(name))
        if "sd_mm" in surface.fields:
            band(axes, surface, level, colour_of(name))
        axes.scatter(*near.T, s=9, color="#222222", zorder=3)
        axes.set_title(title, fontsize=10)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.axis("off")
    figure.tight_layout()
    return figure


if __name__ == "__main__":
    drawn(read_run(sys.argv[1])).savefig(Path(sys.argv[2]) / "method_stages.png", dpi=110)
