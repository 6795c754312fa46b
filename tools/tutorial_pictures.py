"""Draw the pictures of docs/tutorial.md from the folder in which its commands were run, and print how far the
wall is from the true one.

python tools/tutorial_pictures.py FOLDER docs
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import nibabel
import numpy as np
from matplotlib.colors import ListedColormap
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from o3dls import Surface, read_surface
from o3dls.evaluation.distances import distances, sample
from o3dls.io.points import read_points

COLOURS = matplotlib.colormaps["turbo_r"]  # low voltage red, high purple
LABELS = ListedColormap(["#ffffff", "#c9d4e3", "#2a6fb0", "#e08a2e"])
LPS_TO_RAS = np.array([-1.0, -1.0, 1.0])


def drawn(axes: plt.Axes, surface: Surface, values: np.ndarray, most: float) -> None:
    """A surface with values per vertex, grey where there is none; light takes at most 15 % of a colour."""
    corners = surface.vertices[surface.faces]
    mean = values[surface.faces].mean(axis=1)
    light = 0.85 + 0.15 * np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))[
        :, 1
    ] / (2.0 * surface.face_areas)
    colour = np.where(np.isfinite(mean)[:, None], COLOURS(np.nan_to_num(mean) / most)[:, :3], 0.8)
    colour = colour * light[:, None]
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colour, edgecolors=colour, linewidths=0.3))
    for low, high, limits in zip(
        surface.vertices.min(0),
        surface.vertices.max(0),
        (axes.set_xlim, axes.set_ylim, axes.set_zlim),
        strict=True,
    ):
        limits(low, high)
    axes.set_box_aspect(np.ptp(surface.vertices, axis=0), zoom=1.25)
    axes.view_init(elev=10, azim=-75)
    axes.set_axis_off()


def slices(axes: list[plt.Axes], path: Path, outline: Surface | None) -> None:
    """Label slices along the image's second axis, across the thick slices, with where a wall cuts them."""
    image = nibabel.load(path)
    labels = np.asanyarray(image.dataobj)
    rows = np.flatnonzero((labels > 0).any(axis=(0, 2)))
    spacing = np.linalg.norm(image.affine[:3, :3], axis=0)
    for place, axis in zip((0.35, 0.5, 0.65), axes, strict=True):
        row = int(rows[int(place * len(rows))])
        axis.imshow(
            labels[:, row].T,
            origin="lower",
            cmap=LABELS,
            vmin=0,
            vmax=3,
            aspect=spacing[2] / spacing[0],
            interpolation="nearest",
        )
        used = np.argwhere((labels > 0).any(axis=1))
        axis.set_xlim(used[:, 0].min() - 4, used[:, 0].max() + 4)
        axis.set_ylim(used[:, 1].min() - 2, used[:, 1].max() + 2)
        axis.set_xticks([])
        axis.set_yticks([])
        if outline is not None:
            cut(axis, outline, image.affine, row)


def cut(axis: plt.Axes, surface: Surface, affine: np.ndarray, row: int) -> None:
    """Where a surface in LPS crosses one row of voxels."""
    inverse = np.linalg.inv(affine)
    at = surface.vertices * LPS_TO_RAS @ inverse[:3, :3].T + inverse[:3, 3]
    corners = at[surface.faces] - [0.0, row, 0.0]
    for face in corners[(corners[:, :, 1].min(1) < 0) & (corners[:, :, 1].max(1) > 0)]:
        ends = [
            a + (b - a) * a[1] / (a[1] - b[1])
            for a, b in zip(face, np.roll(face, 1, axis=0), strict=True)
            if (a[1] < 0.0) != (b[1] < 0.0)
        ]
        axis.plot(*np.array(ends)[:, [0, 2]].T, color="#a01020", linewidth=1.2)


def main(folder: Path, out: Path) -> None:
    points = read_points(folder / "case/points.csv")
    voltage, most = points.numbers("bipolar"), 3.0
    prior, wall = read_surface(folder / "case/prior.ply"), read_surface(folder / "wall.vtp")

    figure = plt.figure(figsize=(11, 3.6))
    axes = figure.add_subplot(1, 4, 1, projection="3d")
    axes.scatter(*points.xyz.T, c=voltage, cmap=COLOURS, vmin=0, vmax=most, s=7)
    axes.set_title("the map: 400 points, no landmark", fontsize=9)
    axes.set_box_aspect(np.ptp(points.xyz, axis=0))
    axes.tick_params(labelsize=6)
    three = [figure.add_subplot(1, 4, k) for k in (2, 3, 4)]
    slices(three, folder / "study/la_labels.nii.gz", prior)
    three[1].set_title("the label volume across its 5 mm slices, and the prior (red)", fontsize=9)
    figure.tight_layout()
    figure.savefig(out / "tutorial_study.png", dpi=110, bbox_inches="tight")

    figure = plt.figure(figsize=(11, 3.6))
    axes = figure.add_subplot(1, 4, 1, projection="3d")
    drawn(axes, wall, wall.fields["bipolar"], most)
    axes.set_title("bipolar voltage on the image's anatomy", fontsize=9)
    three = [figure.add_subplot(1, 4, k) for k in (2, 3, 4)]
    slices(three, folder / "labels.nii.gz", None)
    three[1].set_title("labels.nii.gz: wall near a point (blue), by the prior alone (orange)", fontsize=9)
    figure.tight_layout()
    figure.savefig(out / "tutorial_result.png", dpi=110, bbox_inches="tight")

    truth = read_surface(folder / "study/true_wall.ply")
    for name in ("global_pose", "level_set"):
        found = read_surface(folder / f"run/estimates/{name}/surface.ply")
        both = (distances(sample(truth), found).mean() + distances(sample(found), truth).mean()) / 2.0
        sys.stdout.write(f"{name}: mean distance from the true wall {both:.2f} mm\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
