"""Maps with something wrong: parts that lie off, points of another chamber, errors that go together, regions
that nobody visited.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from o3dls import Case, Points, Truth
from o3dls.arrays import Array

from . import motion as moves
from . import wall
from .case_points import doubted, kept, true_of, true_surface, with_points, with_xyz
from .catheter import Path, walked
from .segmentation import free_side

Rng = np.random.Generator
SHIFTED = (8.0, 12.0)  # mm that half of a map is off
SIZE = 1.15  # of points in another unit than they say, or of a map that was calibrated wrongly
OTHERS = 0.16  # share of the points that are of another chamber
OTHER_AXES = (16.0, 22.0)  # mm, half axes of that chamber
APART = 3.0  # mm between its wall and this one's
RMS = (1.5, 2.0)  # mm, of errors along a path
OFF = (6.0, 9.0)  # mm that points of one side float inside, or push the wall out
SIDES = {"floating": 0.3, "tented": 0.15}  # share of the wall, on which they do
EDGE = 6.0  # mm over which that sets in
FOLD, CROWDED = 9.0, 0.13  # mm that a side of the wall lies farther inside, and its share of the wall
BREATH = (8.0, 12.0)  # mm from end to end of a breath
BODY = 1.25  # radii: what of a chamber is mapped where no vein is entered
QUARTER = 4  # times fewer points are kept of a map that covers one region


def shifted(rng: Rng, case: Case, part: str) -> Case:
    """The points taken later, or those on one side, lie 8 to 12 mm off in one direction; landmarks, which are
    taken first, do not.
    """
    points = case.points
    wall_ = points.type != "landmark"
    key = np.arange(float(len(points))) if part == "later" else points.xyz @ moves.direction(rng)
    moved = wall_ & (key > np.median(key[points.type == "eam"]))
    offset = rng.uniform(*SHIFTED) * moves.direction(rng)
    return with_xyz(case, points.xyz + moved[:, None] * offset)


def scaled(rng: Rng, case: Case) -> Case:
    """All of the map is larger by 15 %, its landmarks too."""
    middle = case.points.xyz.mean(axis=0)
    return with_xyz(case, middle + SIZE * (case.points.xyz - middle))


def beside(rng: Rng, case: Case) -> Case:
    """Among the points are as many as 16 % of another chamber's wall, an ellipsoid beside this one."""
    surface = true_surface(case)
    way, reach = free_side(rng, surface)
    axes = rng.uniform(*OTHER_AXES, 3)
    depth = float(1.0 / np.linalg.norm(way / axes))
    middle = wall.body(surface)[0] + (reach + APART + depth) * way
    count = round(OTHERS * int((case.points.type == "eam").sum()))
    ball = np.array([moves.direction(rng) for _ in range(count)])
    added = Points(np.round(middle + axes * ball + rng.normal(size=ball.shape), 3), np.full(count, "eam"))
    return with_points(case, added)


def along_a_path(rng: Rng, case: Case) -> Case:
    """The map is taken along a path, with errors that go together."""
    return along(rng, case, Path(int((case.points.type == "eam").sum()), rng.uniform(*RMS)))


def along(rng: Rng, case: Case, how: Path) -> Case:
    """The case with a map that is taken along a path instead of its own; landmarks stay."""
    points, inside = walked(rng, true_surface(case), how)
    bare = kept(case, case.points.type == "landmark")
    truth = replace(true_of(case), unseen=None, outliers=None)
    found = with_points(replace(bare, truth=truth), points)
    rows = np.flatnonzero(found.points.type == "eam")[inside]
    return replace(found, truth=replace(truth, outliers=rows))


def shuffled(rng: Rng, case: Case) -> Case:
    """The points are in no order, without their times and groups, as a sorted table leaves them."""
    rows, truth = rng.permutation(len(case.points)), true_of(case)
    points = case.points.select(rows)
    columns = {name: column for name, column in points.columns.items() if name not in ("time", "group")}
    if truth.outliers is not None:
        truth = replace(truth, outliers=np.flatnonzero(np.isin(rows, truth.outliers)))
    return replace(case, points=replace(points, columns=columns, order=None), truth=truth)


def half(rng: Rng, case: Case) -> Case:
    """Only the points on one side of a plane through the middle are there; landmarks all."""
    key = case.points.xyz @ moves.direction(rng)
    near = (key > np.median(key[case.points.type == "eam"])) | (case.points.type == "landmark")
    return kept(case, near)


def quarter(rng: Rng, case: Case) -> Case:
    """Only the quarter of the points nearest to one of them is there; landmarks all."""
    eam = np.flatnonzero(case.points.type == "eam")
    away = np.linalg.norm(case.points.xyz - case.points.xyz[rng.choice(eam)], axis=1)
    near = away <= np.sort(away[eam])[len(eam) // QUARTER - 1]
    return kept(case, near | (case.points.type == "landmark"))


def without_veins(rng: Rng, case: Case) -> Case:
    """No vein was entered: points within 1.25 radii of the chamber's centre; landmarks all."""
    centre, radius = wall.body(true_surface(case))
    near = np.linalg.norm(case.points.xyz - centre, axis=1) < BODY * radius
    return kept(case, near | (case.points.type == "landmark"))


def one_side(rng: Rng, case: Case, kind: str) -> Case:
    """On one side of the chamber the points float inside, as where a catheter does not reach, or lie outside,
    as where it pushes the wall out.
    """
    there, outward = _one_side(rng, case, SIDES[kind])[:2]
    depth = rng.uniform(*OFF) * (1.0 if kind == "tented" else -1.0)
    found = with_xyz(case, case.points.xyz + depth * there[:, None] * outward)
    return doubted(found, np.flatnonzero(there > 0.0))


def folded(rng: Rng, case: Case) -> Case:
    """On one side the true wall lies 9 mm farther inside than a smooth motion has it, and the points lie on
    it.
    """
    there, outward, at_vertices = _one_side(rng, case, CROWDED)
    found = with_xyz(case, case.points.xyz - FOLD * there[:, None] * outward)
    surface = true_surface(case)
    inward = -FOLD * at_vertices[:, None] * surface.vertex_normals
    moved = replace(surface, vertices=surface.vertices + inward)
    return replace(found, truth=Truth(moved, outliers=true_of(found).outliers))


def crowded(rng: Rng, case: Case) -> Case:
    """On one side the points float at every depth down to 18 mm, as many as `folded` has on its wall."""
    there, outward, _ = _one_side(rng, case, CROWDED)
    depth = rng.uniform(0.0, 2.0 * FOLD, len(there)) * there
    found = with_xyz(case, case.points.xyz - depth[:, None] * outward)
    return doubted(found, np.flatnonzero(there > 0.0))


def _one_side(rng: Rng, case: Case, share: float) -> tuple[Array, Array, Array]:
    """How far (n,) each mapping point is within one side, a share of the wall, from 0 to 1 over its edge; the
    outward normals (n, 3) of the wall next to the points; how far (v,) the vertices of the true wall are.
    """
    surface = true_surface(case)
    way, reach = free_side(rng, surface)
    middle = wall.body(surface)[0] + reach * way
    away = np.linalg.norm(surface.vertices - middle, axis=1)
    order = np.argsort(away)
    area = np.cumsum(wall.vertex_areas(surface)[order])
    radius = away[order[np.searchsorted(area, share * area[-1])]]
    there = np.clip((radius - np.linalg.norm(case.points.xyz - middle, axis=1)) / EDGE, 0.0, 1.0)
    there[case.points.type != "eam"] = 0.0
    outward = surface.face_normals[surface.closest_point.query(case.points.xyz)[1]]
    return there, outward, np.clip((radius - away) / EDGE, 0.0, 1.0)


def breathing(rng: Rng, case: Case) -> Case:
    """Every point, but for the landmarks, was taken at some moment of a breath of 8 to 12 mm; the wall is
    that of its end.
    """
    moment = 0.5 - 0.5 * np.cos(rng.uniform(0.0, 2.0 * np.pi, len(case.points)))
    moment[case.points.type == "landmark"] = 0.0
    shift = rng.uniform(*BREATH) * moves.direction(rng)
    return with_xyz(case, case.points.xyz + moment[:, None] * shift)
