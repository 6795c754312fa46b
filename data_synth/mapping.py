"""What a mapping system exports of a wall that is given as a mesh: points, some of them inside, and marked
places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from o3dls import Case, Points, Surface, Truth

from . import sampling
from .sampling import Mask, Rows, Sites
from .shapes import Array

PER_POINT = (0.5, 2.0)  # mm, from which each point's own noise is drawn
MARKED_SD = 2.0  # mm, how well an operator marks a place in the map
UNSEEN = 0.25  # share of the wall that a clustered map leaves out
DEPTH = (3.0, 12.0)  # mm, how far inside outliers are; no deeper than half way to the other wall
HELD_OUT = 4000


@dataclass(frozen=True)
class Mapping:
    """How a wall is mapped: number of points; sd of their noise per axis in mm, or None for one of 0.5 to 2
    mm per point; clustered, with a quarter of the wall unseen, or even; share of the points that lie inside
    the chamber; whether the noise of each is told in a column `sigma`.
    """

    points: int = 250
    noise: float | None = 1.0
    clustered: bool = True
    outliers: float = 0.0
    told: bool = False

    def __str__(self) -> str:
        noise = "0.5 to 2 mm per point" if self.noise is None else f"{self.noise:g} mm"
        spread = f"clustered, {UNSEEN:.2f} unseen" if self.clustered else "even"
        return f"{self.points} points, {spread}, noise {noise}, outliers {self.outliers:.2f}"


def mapped(
    rng: np.random.Generator,
    truth: Surface,
    how: Mapping,
    marks: dict[str, Array],
    missed: Mask | None = None,
) -> tuple[Points, Truth]:
    """The map of a wall, with marked places (3,) by name, and what is true of it: surface, held-out points,
    unseen areas, outliers. The places that are seen do not depend on noise or number. `missed` names the
    faces (m,) where no catheter was; even points are then such as a density filter leaves.
    """
    unseen, visits, hand, test = rng.spawn(4)
    hidden = _hidden(unseen, truth, how) if missed is None else missed
    density = sampling.clustered(unseen, truth, ~hidden) if how.clustered else 1.0 * ~hidden
    taken = sampling.sites if how.clustered or missed is None else sampling.filtered
    at = taken(visits, truth, how.points, density)
    sd = hand.uniform(*PER_POINT, how.points) if how.noise is None else np.full(how.points, how.noise)
    inside, depth = _inside(hand, truth, at, how.outliers)
    wall = at.xyz.copy()
    wall[inside] -= depth[:, None] * truth.face_normals[at.face[inside]]
    xyz = wall + sd[:, None] * hand.normal(size=wall.shape)
    marked = np.array(list(marks.values())).reshape(-1, 3) + MARKED_SD * hand.normal(size=(len(marks), 3))
    columns = {"name": np.array([""] * how.points + list(marks))} if marks else {}
    if how.told:
        columns["sigma"] = np.round(np.concatenate([sd, np.full(len(marks), MARKED_SD)]), 3)
    kind = np.repeat(["eam", "landmark"], [how.points, len(marks)])
    held_out = sampling.sites(test, truth, HELD_OUT)
    return Points(np.vstack([xyz, marked]).round(3), kind, columns), Truth(
        truth, held_out.xyz, hidden[held_out.face], None, inside
    )


def _hidden(rng: np.random.Generator, truth: Surface, how: Mapping) -> Mask:
    """Faces that are not mapped: three patches, none where points are even."""
    middles = sampling.sites(rng, truth, 3).xyz
    return sampling.patches(truth, middles, UNSEEN if how.clustered else 0.0)


def _inside(rng: np.random.Generator, truth: Surface, at: Sites, share: float) -> tuple[Rows, Array]:
    """Rows of the points that float in the blood, and how deep (mm)."""
    count = round(share * len(at.xyz))
    order = rng.permutation(len(at.xyz))
    if not count:
        return order[:0], np.zeros(0)
    room = 0.5 * _across(truth, at)
    rows = np.sort(order[room[order] > DEPTH[0]][:count])
    return rows, np.minimum(rng.uniform(*DEPTH, len(rows)), room[rows])


def _across(truth: Surface, at: Sites) -> Array:
    """Way (n,) from sites straight in to the other wall."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(truth.vertices.astype(np.float32), truth.faces.astype(np.uint32))
    inward = -truth.face_normals[at.face]
    rays = np.hstack([at.xyz + 1e-2 * inward, inward]).astype(np.float32)
    return np.asarray(scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy().astype(np.float64))


def case_of(
    name: str,
    prior: Surface,
    found: tuple[Points, Truth],
    start: dict[str, Array] | Array,
    notes: str,
) -> Case:
    """The case: it starts from landmarks of the prior, where these are given, or from a rough pose (4, 4)."""
    points, truth = found
    marks, init = (start, None) if isinstance(start, dict) else ({}, start)
    return Case(name, prior, points, marks, init, notes=notes, truth=truth)
