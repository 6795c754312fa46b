"""Surfaces as they are drawn: with every field that can be shown, and with few enough faces for any
machine.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...case import Case
from ...geometry.surface import Surface, interpolated
from .electrical import with_electrical

MOST_FACES = 60_000  # a surface with more is decimated for display to
DISPLAY_FACES = 36_000
TRUTH = "distance_to_truth"


def displayed(surface: Surface, case: Case) -> Surface:
    """A surface of an estimate, decimated if need be, with electrical values, and the distance to truth where
    that is known.
    """
    from ...evaluation.distances import distances

    surface = with_electrical(decimated(surface), case.points)
    if case.truth is None or case.truth.surface is None:
        return surface
    return replace(
        surface,
        fields={f"{TRUTH}_{case.units}": distances(surface.vertices, case.truth.surface), **surface.fields},
    )


def decimated(surface: Surface, most: int = MOST_FACES, wanted: int = DISPLAY_FACES) -> Surface:
    """The surface, or one of `wanted` faces where it has more than `most`; fields are carried over by closest
    point.
    """
    if len(surface.faces) <= most or surface.dimension == 2:
        return surface
    from ...geometry.closest_point import ClosestPoint

    small = _fewer_faces(surface, wanted)
    _, face, _, weights = ClosestPoint(surface.vertices, surface.faces).query(small.vertices)
    fields = {
        key: interpolated(values, surface.faces[face], weights) for key, values in surface.fields.items()
    }
    return replace(small, fields=fields)


def _fewer_faces(surface: Surface, faces: int) -> Surface:
    import open3d as o3d

    corners = o3d.utility.Vector3iVector(surface.faces.astype(np.int32))
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(surface.vertices), corners
    ).simplify_quadric_decimation(faces)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.triangles))
