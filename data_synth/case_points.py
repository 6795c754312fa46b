"""Cases with other points, whose truth follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from o3dls import Case, InputError, Points, Surface, Truth

from .sampling import Mask, Rows
from .shapes import Array


def true_surface(case: Case) -> Surface:
    surface = true_of(case).surface
    assert surface is not None
    return surface


def true_of(case: Case) -> Truth:
    if case.truth is None:
        raise InputError(f"{case.name}: has no truth to alter it by")
    return case.truth


def with_xyz(case: Case, xyz: Array) -> Case:
    return replace(case, points=replace(case.points, xyz=np.round(xyz, 3)))


def kept(case: Case, kept: Mask) -> Case:
    """The case with some of its points; the rows of its outliers follow."""
    truth = true_of(case)
    if truth.outliers is not None:
        rows = np.cumsum(kept) - 1
        truth = replace(truth, outliers=rows[truth.outliers[kept[truth.outliers]]])
    points = case.points.select(kept)
    return replace(case, points=replace(points, order=None), truth=truth)


def with_points(case: Case, added: Points) -> Case:
    """The case with mapping points behind its own, all of them outliers unless their rows are known."""
    own, n = case.points, len(case.points)
    names = dict.fromkeys([*own.columns, *added.columns])
    columns = {name: np.concatenate([_column(own, name, added), _column(added, name, own)]) for name in names}
    points = Points(np.vstack([own.xyz, added.xyz]), np.append(own.type, added.type), columns)
    truth = true_of(case)
    before = np.zeros(0, dtype=np.int64) if truth.outliers is None else truth.outliers
    outliers = np.append(before, np.arange(n, n + len(added)))
    return replace(case, points=points, truth=replace(truth, outliers=outliers))


def _column(points: Points, name: str, like: Points) -> Array:
    """A column (n,), with what means nothing where the points do not have it."""
    if name in points.columns:
        return np.asarray(points.columns[name])
    text = like.columns[name].dtype.kind == "U"
    return np.full(len(points), "" if text else np.nan)


def doubted(case: Case, rows: Rows) -> Case:
    """The case, of which these points too do not touch the wall."""
    truth = true_of(case)
    before = np.zeros(0, dtype=np.int64) if truth.outliers is None else truth.outliers
    return replace(case, truth=replace(truth, outliers=np.union1d(before, rows)))
