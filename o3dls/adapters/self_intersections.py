"""Faces that cut through other faces of the same surface: pymeshlab's selection in 3D, segments in 2D."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.surface import Surface, crossed_by

BLOCK = 64  # segments that are compared with all the others at once
SHAKEN = 1e-8  # diagonals: a nanometre of an atrium


def self_intersections(surface: Surface) -> int:
    """Return the number of faces that cut through another face."""
    return int(crossing(surface).sum())


def crossing(surface: Surface) -> NDArray[np.bool_]:
    """Return faces (m,) that cut through another face. In 2D every segment against every other: outlines have
    hundreds of them, not millions.
    """
    if surface.dimension == 2:
        rows = [slice(k, k + BLOCK) for k in range(0, len(surface.faces), BLOCK)]
        return np.concatenate([crossed_by(surface, block).any(axis=1) for block in rows])
    return _crossing_triangles(surface)


def _crossing_triangles(surface: Surface) -> NDArray[np.bool_]:
    """Return the faces that pymeshlab takes for crossing, and does again on vertices that are shaken a
    little: of faces that lie side by side in one plane it takes some for crossing, depending on how they are
    turned. Walls that touch cross only once they are shaken.
    """
    found = _select_crossing(surface)
    if found.any():
        shaken = SHAKEN * surface.diagonal * np.random.default_rng(0).normal(size=surface.vertices.shape)
        found &= _select_crossing(surface.with_vertices(surface.vertices + shaken))
    return found


def _select_crossing(surface: Surface) -> NDArray[np.bool_]:
    """Return faces (m,) that pymeshlab takes for crossing another one."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.vertices, surface.faces.astype(np.int32)))
    meshes.compute_selection_by_self_intersections_per_face()
    return np.asarray(meshes.current_mesh().face_selection_array(), dtype=bool)
