"""Faces that are folded over: found, and relaxed by moving their corners between those around them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .surface import Surface

Faulty = Callable[[Surface], NDArray[np.bool_]]


def flipped(surface: Surface) -> NDArray[np.bool_]:
    """Find the faces (m,) that look against the mean direction of the surface at their own corners, as
    folded-over faces do.
    """
    # imported here, so that reading a file does not compile code
    from .differential import face_normals, vertex_normals

    around = vertex_normals(surface.vertices, surface.faces)[surface.faces]
    own = face_normals(surface.vertices, surface.faces)
    return np.asarray(np.einsum("mcd,md->m", around, own) < 0.0)


def relaxed(surface: Surface, faulty: Faulty = flipped, rounds: int = 20, rings: int = 1) -> Surface:
    """Return the surface with the corners of flipped faces moved to the mean of those around each until no
    face is flipped, or for so many rounds; up to so many rings of neighbours too if that leaves a face
    flipped, and then the surface which has fewest.

    faulty: which faces (m,) of a surface are to be relaxed, if others than the flipped ones.
    """
    # beside a cut, neighbours that move as well may turn over faces that were right
    best, least = surface, np.inf
    for wide in range(rings + 1):
        found = _relax_corners(surface, faulty, rounds, wide)
        left = faulty(found).sum()
        if left < least:
            best, least = found, left
        if left == 0:
            break
    return best


def _relax_corners(surface: Surface, faulty: Faulty, rounds: int, rings: int) -> Surface:
    """Move the corners of faulty faces, and so many rings of vertices about them."""
    faces, count = surface.faces, len(surface.vertices)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()  # each edge of a closed mesh both ways
    number = np.maximum(np.bincount(start, minlength=count), 1)
    for _ in range(rounds):
        bad = faulty(surface)
        if not bad.any():
            break
        moved = np.zeros(count, dtype=bool)
        moved[faces[bad]] = True
        for _ in range(rings):
            moved[faces[moved[faces].any(axis=1)]] = True
        mean = np.column_stack([np.bincount(start, x[end], count) / number for x in surface.vertices.T])
        surface = surface.with_vertices(np.where(moved[:, None], mean, surface.vertices))
    return surface
