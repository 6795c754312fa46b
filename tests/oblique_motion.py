"""A chamber in an image whose voxels are oblique and longer than wide, and a run that moves it smoothly: what
frames, axes and units are tested with. Nothing of it is alike from two sides.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.estimate import Estimate
from o3dls.geometry.similarity import TURN, apply, fit_similarity, similarity
from o3dls.geometry.surface import Surface
from o3dls.io.images.volumes import write_volume
from o3dls.pipeline.pipeline import Pipeline
from o3dls.plugins.stage import Stage
from o3dls.runs.export.volume import _label_voxels
from o3dls.runs.run import Run
from tests.tiny import sphere

SEED = 730_411
SPACING = np.array([0.9, 1.3, 2.4])
AXES = np.linalg.qr(np.array([[0.9, -0.3, 0.2], [0.35, 0.8, -0.4], [0.1, 0.5, 0.85]]))[0]
ORIGIN = np.array([-70.0, 15.0, 42.0])
SHAPE = (84, 62, 36)
# LPS, mm, of a voxel's centre; of a right-handed grid
AFFINE = similarity(AXES * np.sign(np.diag(AXES)) * SPACING, ORIGIN)
POSE = similarity(
    np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]]), np.array([40.0, -7.0, 90.0]), 1.1
)
MIDDLE = apply(AFFINE, np.array([SHAPE]) / 2.0)[0]
NAMES = ("LSPV", "RSPV", "LIPV", "RIPV")


def chamber() -> Surface:
    """An egg with a bump, in LPS, within the image."""
    ball = sphere(1.0, rings=24)
    x, y, z = ball.vertices.T
    bump = 1.0 + 0.35 * np.exp(-((x - 0.7) ** 2 + (y - 0.5) ** 2 + z**2) / 0.12)
    local = ball.vertices * bump[:, None] * [24.0, 17.0, 20.0] * (1.0 + 0.15 * y[:, None])
    return ball.with_vertices(MIDDLE + local @ AXES.T)


def smooth_shift(points: Array, size: float = 1.0) -> Array:
    """What a place of the image moves by, in LPS, before the pose."""
    x, y, z = ((points - MIDDLE) / 25.0).T
    return size * np.column_stack(
        [2.0 * np.sin(y) + 0.8, 1.5 * np.cos(1.3 * z) * x, 1.2 * np.sin(x + 0.5 * y)]
    )


def turn_of(frame: str) -> Array:
    return TURN if frame == "RAS" else np.eye(4)


class Smooth:
    """The motion between a prior in one frame and a map in another."""

    def __init__(self, prior_frame: str, frame: str, size: float = 1.0) -> None:
        self.to_lps, self.to_map, self.size = turn_of(prior_frame), turn_of(frame), size

    def __call__(self, points: Array) -> Array:
        lps = apply(self.to_lps, points)
        return apply(self.to_map @ POSE, lps + smooth_shift(lps, self.size))

    def sd(self, points: Array, normals: Array) -> Array:
        return np.full(len(points), 0.7)


class Moved(Stage):
    """Moves the prior by the smooth motion, whose pose is the nearest similarity."""

    name: ClassVar[str] = "moved"
    prior_frame: Literal["LPS", "RAS"] = Field("LPS", description="frame of the prior")
    size: float = Field(1.0, description="how large the motion is", json_schema_extra={"unit": "1"})

    def __call__(self, case: Case, start: Estimate) -> Estimate:
        motion = Smooth(self.prior_frame, case.frame, self.size)
        moved = motion(case.prior.vertices)
        pose = fit_similarity(case.prior.vertices, moved)
        return Estimate(case.prior.with_vertices(moved), pose, "moved", motion=motion, sigma=0.5)


def oblique_case(prior_frame: str = "LPS", frame: str = "LPS") -> Case:
    """The chamber as the prior, in its frame; points on the wall and landmarks, in that of the map."""
    rng = np.random.default_rng(SEED)
    prior = chamber().transformed(turn_of(prior_frame))
    motion = Smooth(prior_frame, frame)
    rows = rng.choice(len(prior.vertices), 90, replace=False)
    measured = motion(prior.vertices[rows]) + 0.3 * rng.normal(size=(90, 3)) @ turn_of(frame)[:3, :3]
    corners = prior.vertices[rng.choice(len(prior.vertices), 4, replace=False)]
    marks = dict(zip(NAMES, corners, strict=True))
    kind = np.array(["eam"] * 70 + ["ablation"] * 20 + ["landmark"] * 4)
    columns = {
        "name": np.array([""] * 90 + list(NAMES)),
        "bipolar": np.where(kind == "eam", rng.uniform(0.05, 4.0, 94), np.nan),
    }
    points = Points(np.vstack([measured, motion(corners)]), kind, columns)
    return Case("oblique", prior, points, marks, frame=frame, prior_frame=prior_frame)


def oblique_run(prior_frame: str = "LPS", frame: str = "LPS", size: float = 1.0) -> Run:
    stage = Moved(prior_frame=prior_frame, size=size)
    return Pipeline([stage], folds=0).run(oblique_case(prior_frame, frame))


def image() -> NDArray[np.uint8]:
    """The chamber as labels (nx, ny, nz) on the oblique voxels: 2 inside, 1 in a part of it."""
    inside = _label_voxels(chamber(), AFFINE, SHAPE) > 0
    part = np.arange(SHAPE[0]) > 50
    return np.where(inside, np.where(part[:, None, None], 1, 2), 0).astype(np.uint8)


def write_image(path: Path, space: str = "LPS") -> Path:
    """Write the labels, in an image whose axes are given in LPS or RAS."""
    write_volume(path, image(), turn_of(space) @ AFFINE, space=space)
    return path
