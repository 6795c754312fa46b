"""Connected components of a surface, their areas, and its Euler number."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..arrays import Array, Ints
from .surface import Surface, used_by

SMALL_COMPONENT = 0.01  # area of a piece over that of the largest: no vein, appendage or chamber is so small


def component_labels(count: int, faces: Ints) -> Ints:
    """Number (count,) of the connected piece that each of `count` vertices belongs to."""
    ends = np.roll(faces, -1, axis=1)
    links = sparse.csr_matrix((np.ones(faces.size), (faces.ravel(), ends.ravel())), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def components_and_euler(vertices: Array, faces: Ints) -> tuple[int, int]:
    """Pieces and Euler number of a closed surface (2 per piece without handles in 3D, 0 in 2D)."""
    used, renumbered = used_by(len(vertices), faces)
    count = int(component_labels(int(used.sum()), renumbered).max(initial=-1)) + 1
    n = int(used.sum())
    # a triangle has half of three edges
    return count, n - (len(faces) // 2 if faces.shape[1] == 3 else len(faces))


def component_areas(surface: Surface) -> tuple[Ints, Array]:
    """Number (m,) of the connected piece that each face is of, and the areas (k,) of the pieces."""
    _, piece = np.unique(
        component_labels(len(surface.vertices), surface.faces)[surface.faces[:, 0]], return_inverse=True
    )
    return np.asarray(piece, dtype=np.int64), np.asarray(
        np.bincount(piece, surface.face_areas), dtype=np.float64
    )


def largest_component(vertices: Array, faces: Ints) -> tuple[Array, Ints]:
    """The connected piece of a closed surface that encloses most, without the vertices of the others."""
    label = component_labels(len(vertices), faces)
    corners = vertices[faces] - vertices.mean(axis=0)
    piece = np.bincount(label[faces[:, 0]], weights=np.linalg.det(corners))
    kept = faces[label[faces[:, 0]] == piece.argmax()]
    used, renumbered = used_by(len(vertices), kept)
    return vertices[used], renumbered
