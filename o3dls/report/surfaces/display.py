"""Surfaces as they are drawn: with every field that can be shown, and with few enough faces for any
machine.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ...adapters.decimation import reduced
from ...arrays import Array, Ints
from ...case import Case
from ...evaluation.interpolation import REACH, to_surface
from ...evaluation.projection import project
from ...geometry.label_fields import read_at
from ...geometry.surface import Surface, interpolated
from .electrical import with_electrical

MOST_FACES = 60_000  # a surface with more is decimated to DISPLAY_FACES
DISPLAY_FACES = 36_000
TRUTH, LEFT_OUT = "distance_to_truth", "left_out"
NEGLIGIBLE = 1e-6  # smaller displacements are rounding errors: a pose alone does not bend the prior


def displayed(surface: Surface, case: Case, left_out: Array, distances: Array) -> Surface:
    """Make a surface of an estimate ready to be drawn: decimated if need be, with electrical values, the
    distance to truth where that is known, and the distances (k,) of points (k, d) that were left out in turn,
    carried to the wall.

    It has no displacement where a pose alone has moved it.
    """
    surface = with_electrical(decimated(surface, like=case.prior), case.points)
    carried = _carry_distances(surface, case.units, left_out, distances)
    fields = {**_distances_to_truth(surface, case), **surface.fields, **carried}
    key = f"displacement_{case.units}"
    if key in fields and (np.nan_to_num(np.abs(fields[key])) <= NEGLIGIBLE).all():
        del fields[key]
    return replace(surface, fields=fields)


def _distances_to_truth(surface: Surface, case: Case) -> dict[str, Array]:
    from ...evaluation.distances import distances

    if case.truth is None or case.truth.surface is None:
        return {}
    return {f"{TRUTH}_{case.units}": distances(surface.vertices, case.truth.surface)}


def _carry_distances(surface: Surface, unit: str, xyz: Array, values: Array) -> dict[str, Array]:
    """Carry distances (k,) of points (k, d) to the surface as a field, NaN far from all of them; none where
    all are far.
    """
    if len(xyz) == 0 or (project(xyz, surface).distance > REACH).all():
        return {}
    return {f"{LEFT_OUT}_{unit}": to_surface(xyz, values, surface)}


def decimated(
    surface: Surface, most: int = MOST_FACES, wanted: int = DISPLAY_FACES, *, like: Surface | None = None
) -> Surface:
    """Return the surface, or one of `wanted` faces where it has more than `most`; fields are carried over by
    closest point. Where it has the faces of another one, it is decimated `like` that, which is done once for
    all that have.
    """
    if len(surface.faces) <= most or surface.dimension == 2:
        return surface
    if like is None or not np.array_equal(surface.faces, like.faces):
        small, corners, weights = _reduce_faces(surface, wanted)
    else:
        small, corners, weights = _reduce_once(like, wanted)
        small = small.with_vertices(interpolated(surface.vertices, corners, weights))
    fields = {key: read_at(key, values, corners, weights) for key, values in surface.fields.items()}
    return replace(small, fields=fields)


def _reduce_faces(surface: Surface, wanted: int) -> tuple[Surface, Ints, Array]:
    """Return a surface of fewer faces, and where its vertices (n, 3) lie on the other: among which of its
    vertices (n, 3), with which weights (n, 3).
    """
    small = reduced(surface, wanted)
    _, face, _, weights = surface.closest_point.query(small.vertices)
    return small, surface.faces[face], weights


@lru_cache(maxsize=3)  # surfaces of one prior are drawn in up to three sizes
def _reduce_once(surface: Surface, wanted: int) -> tuple[Surface, Ints, Array]:
    return _reduce_faces(surface, wanted)
