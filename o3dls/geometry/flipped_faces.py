"""Faces that are folded over: found, and relaxed by moving their corners between those around them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .surface import Surface


def flipped(surface: Surface) -> NDArray[np.bool_]:
    """Find the faces (m,) that look against the mean direction of the surface at their own corners, as
    folded-over faces do.
    """
    # imported here, so that reading a file does not compile code
    from .differential import face_normals, vertex_normals

    around = vertex_normals(surface.vertices, surface.faces)[surface.faces]
    own = face_normals(surface.vertices, surface.faces)
    return np.asarray(np.einsum("mcd,md->m", around, own) < 0.0)


def relaxed(surface: Surface, rounds: int = 20) -> Surface:
    """Return the surface with the corners of flipped faces moved to the mean of those around each until no
    face is flipped, or for so many rounds; their neighbours too if that leaves a face flipped, and then that
    of the two which has fewer.
    """
    # beside a cut, neighbours that move as well may turn over faces that were right
    alone = _relax_corners(surface, rounds, rings=0)
    left = flipped(alone).sum()
    if left == 0:
        return alone
    wider = _relax_corners(surface, rounds, rings=1)
    return wider if flipped(wider).sum() < left else alone


def _relax_corners(surface: Surface, rounds: int, rings: int) -> Surface:
    """Move the corners of flipped faces, and so many rings of vertices about them."""
    faces, count = surface.faces, len(surface.vertices)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()  # each edge of a closed mesh both ways
    number = np.maximum(np.bincount(start, minlength=count), 1)
    for _ in range(rounds):
        bad = flipped(surface)
        if not bad.any():
            break
        moved = np.zeros(count, dtype=bool)
        moved[faces[bad]] = True
        for _ in range(rings):
            moved[faces[moved[faces].any(axis=1)]] = True
        mean = np.column_stack([np.bincount(start, x[end], count) / number for x in surface.vertices.T])
        surface = surface.with_vertices(np.where(moved[:, None], mean, surface.vertices))
    return surface
