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
    """Return the surface with the corners of flipped faces, and their neighbours, moved to the mean of those
    around each until no face is flipped, or for so many rounds.
    """
    for _ in range(rounds):
        bad = flipped(surface)
        if not bad.any():
            break
        moved = np.zeros(len(surface.vertices), dtype=bool)
        moved[surface.faces[bad]] = True
        moved[surface.faces[moved[surface.faces].any(axis=1)]] = True
        faces = surface.faces
        start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()  # each edge of a closed mesh both ways
        number = np.maximum(np.bincount(start, minlength=len(moved)), 1)
        mean = np.column_stack([np.bincount(start, x[end], len(moved)) / number for x in surface.vertices.T])
        surface = surface.with_vertices(np.where(moved[:, None], mean, surface.vertices))
    return surface
