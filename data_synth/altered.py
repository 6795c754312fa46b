"""Cases with something wrong, as happens to people: the segmentation leaked, the patient moved, the map is
another's. Each alteration takes a good case of any generator; what is true of the wall stays true.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from o3dls import Case, InputError, Points, Surface, Truth

from . import motion as moves
from . import pose, wall
from .catheter import Path, walked
from .sampling import Mask
from .segmentation import coarse, free_side, leaked
from .shapes import Array

Rng = np.random.Generator
Alteration = Callable[[Rng, Case], Case]
LOST = (25.0, 40.0)  # mm and degrees by which a rough pose is off
SHIFTED = (8.0, 12.0)  # mm that half of a map is off
MISMARKED = (15.0, 25.0)  # mm that a landmark is off
SIZE = 1.15  # of points in another unit than they say, or of a map that was calibrated wrongly
OTHERS = 0.16  # share of the points, that are of another chamber
OTHER_AXES = (16.0, 22.0)  # mm, half axes of that chamber
APART = 3.0  # mm between its wall and this one's
RMS = (1.5, 2.0)  # mm, of errors along a path


def altered(case: Case, kind: str, seed: int) -> Case:
    """The case with something wrong; equal seeds do equal things. Raises InputError for a kind that there is
    not.
    """
    if kind not in ALTERATIONS:
        raise InputError(f"no alteration '{kind}': there are {', '.join(ALTERATIONS)}")
    found = ALTERATIONS[kind](np.random.default_rng((seed, 7331)), case)
    return replace(found, name=f"{kind}_{seed}", notes=f"{kind}: {case.notes}")


def _leaked(rng: Rng, case: Case, into: str) -> Case:
    return replace(case, prior=leaked(rng, case.prior, "aorta" if into == "aorta" else "ventricle"))


def _segmented(rng: Rng, case: Case) -> Case:
    return replace(case, prior=coarse(rng, case.prior))


def _mirrored(rng: Rng, case: Case) -> Case:
    """Left and right of the prior exchanged, its landmarks too."""
    turn = np.array([-1.0, 1.0, 1.0])
    middle = case.prior.vertices.mean(axis=0)
    prior = Surface(middle + turn * (case.prior.vertices - middle), case.prior.faces[:, ::-1])
    marks = {name: middle + turn * (at - middle) for name, at in case.prior_landmarks.items()}
    truth = replace(_truth(case), correspondence=None)
    return replace(case, prior=prior, prior_landmarks=marks, truth=truth)


def _lost(rng: Rng, case: Case) -> Case:
    """No landmarks, and a rough pose that is off by 25 mm and 40 degrees."""
    pairs = _truth(case).correspondence
    if pairs is None:
        raise InputError(f"{case.name}: has no correspondence, which tells the pose")
    found = pose.similarity_of(*pairs)
    rigid = pose.matrix(found[:3, :3] / np.cbrt(np.linalg.det(found[:3, :3])), np.zeros(3))
    rigid[:3, 3] = (pairs[1] - pose.under(rigid, pairs[0])).mean(axis=0)
    turn, about = moves.turn(rng, np.deg2rad(LOST[1])), pairs[1].mean(axis=0)
    off = pose.matrix(turn, about - turn @ about + LOST[0] * moves.direction(rng))
    return replace(_kept(case, case.points.type != "landmark"), prior_landmarks={}, init=off @ rigid)


def _shifted(rng: Rng, case: Case, part: str) -> Case:
    """The points taken later, or those on one side, lie 8 to 12 mm off in one direction; landmarks, which are
    taken first, do not.
    """
    points = case.points
    wall_ = points.type != "landmark"
    key = np.arange(float(len(points))) if part == "later" else points.xyz @ moves.direction(rng)
    moved = wall_ & (key > np.median(key[points.type == "eam"]))
    offset = rng.uniform(*SHIFTED) * moves.direction(rng)
    return _with_xyz(case, points.xyz + moved[:, None] * offset)


def _swapped(rng: Rng, case: Case) -> Case:
    """Two of the measured landmarks have each other's names."""
    marks = np.flatnonzero(case.points.type == "landmark")
    one, other = rng.choice(marks, 2, replace=False)
    xyz = case.points.xyz.copy()
    xyz[[one, other]] = xyz[[other, one]]
    return _with_xyz(case, xyz)


def _mismarked(rng: Rng, case: Case) -> Case:
    """One of the measured landmarks is 15 to 25 mm off."""
    xyz = case.points.xyz.copy()
    row = rng.choice(np.flatnonzero(case.points.type == "landmark"))
    xyz[row] += rng.uniform(*MISMARKED) * moves.direction(rng)
    return _with_xyz(case, xyz)


def _scaled(rng: Rng, case: Case) -> Case:
    """All of the map is larger by 15 %, its landmarks too."""
    middle = case.points.xyz.mean(axis=0)
    return _with_xyz(case, middle + SIZE * (case.points.xyz - middle))


def _beside(rng: Rng, case: Case) -> Case:
    """Among the points are as many as 16 % of another chamber's wall, an ellipsoid beside this one."""
    surface = _surface(case)
    way, reach = free_side(rng, surface)
    axes = rng.uniform(*OTHER_AXES, 3)
    depth = float(1.0 / np.linalg.norm(way / axes))
    middle = wall.body(surface)[0] + (reach + APART + depth) * way
    count = round(OTHERS * int((case.points.type == "eam").sum()))
    ball = np.array([moves.direction(rng) for _ in range(count)])
    added = Points(np.round(middle + axes * ball + rng.normal(size=ball.shape), 3), np.full(count, "eam"))
    return _with_points(case, added)


def _path(rng: Rng, case: Case) -> Case:
    """The map is taken along a path, with errors that go together."""
    how = Path(int((case.points.type == "eam").sum()), rng.uniform(*RMS))
    points, inside = walked(rng, _surface(case), how)
    bare = _kept(case, case.points.type == "landmark")
    truth = replace(_truth(case), unseen=None, outliers=None)
    found = _with_points(replace(bare, truth=truth), points)
    rows = np.flatnonzero(found.points.type == "eam")[inside]
    return replace(found, truth=replace(truth, outliers=rows))


def _half(rng: Rng, case: Case) -> Case:
    """Only the points on one side of a plane through the middle are there; landmarks all."""
    key = case.points.xyz @ moves.direction(rng)
    kept = (key > np.median(key[case.points.type == "eam"])) | (case.points.type == "landmark")
    return _kept(case, kept)


def _surface(case: Case) -> Surface:
    surface = _truth(case).surface
    assert surface is not None
    return surface


def _truth(case: Case) -> Truth:
    if case.truth is None:
        raise InputError(f"{case.name}: has no truth to alter it by")
    return case.truth


def _with_xyz(case: Case, xyz: Array) -> Case:
    return replace(case, points=replace(case.points, xyz=np.round(xyz, 3)))


def _kept(case: Case, kept: Mask) -> Case:
    """The case with some of its points; the rows of its outliers follow."""
    truth = _truth(case)
    if truth.outliers is not None:
        rows = np.cumsum(kept) - 1
        truth = replace(truth, outliers=rows[truth.outliers[kept[truth.outliers]]])
    points = case.points.select(kept)
    return replace(case, points=replace(points, order=None), truth=truth)


def _with_points(case: Case, added: Points) -> Case:
    """The case with mapping points behind its own, all of them outliers unless their rows are known."""
    own, n = case.points, len(case.points)
    names = dict.fromkeys([*own.columns, *added.columns])
    columns = {name: np.concatenate([_column(own, name, added), _column(added, name, own)]) for name in names}
    points = Points(np.vstack([own.xyz, added.xyz]), np.append(own.type, added.type), columns)
    truth = _truth(case)
    before = np.zeros(0, dtype=np.int64) if truth.outliers is None else truth.outliers
    outliers = np.append(before, np.arange(n, n + len(added)))
    return replace(case, points=points, truth=replace(truth, outliers=outliers))


def _column(points: Points, name: str, like: Points) -> Array:
    """A column (n,), with what means nothing where the points do not have it."""
    if name in points.columns:
        return np.asarray(points.columns[name])
    text = like.columns[name].dtype.kind == "U"
    return np.full(len(points), "" if text else np.nan)


ALTERATIONS: Mapping[str, Alteration] = {
    "aorta": partial(_leaked, into="aorta"),
    "ventricle": partial(_leaked, into="ventricle"),
    "segmented": _segmented,
    "mirrored": _mirrored,
    "lost": _lost,
    "later": partial(_shifted, part="later"),
    "side": partial(_shifted, part="side"),
    "swapped": _swapped,
    "mismarked": _mismarked,
    "scaled": _scaled,
    "beside": _beside,
    "path": _path,
    "half": _half,
}
