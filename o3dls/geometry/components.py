"""Connected components of a surface, their areas, and its Euler number."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..arrays import Array, Ints
from .surface import Surface, used_by

SMALL_COMPONENT = 0.01  # area of a piece over that of the largest: no vein, appendage or chamber is so small


def component_labels(count: int, faces: Ints) -> Ints:
    """Return the number (count,) of the connected piece that each of `count` vertices belongs to by faces, or
    edges, (m, d), in the order of their first vertices.
    """
    return np.asarray(_label_pieces(count, faces))


@njit(cache=True, nogil=True)
def _label_pieces(count, faces):  # type: ignore[no-untyped-def]
    """Label the sets of vertices that faces join, by a number each (a union-find forest whose root is the
    first vertex).
    """
    first = np.arange(count)
    for k in range(len(faces)):
        a = _find_first(first, faces[k, 0])
        for c in range(1, faces.shape[1]):
            b = _find_first(first, faces[k, c])
            first[max(a, b)] = a = min(a, b)
    pieces = 0
    for vertex in range(count):
        if first[vertex] == vertex:
            first[vertex] = pieces
            pieces += 1
        else:  # its root is an earlier vertex, already numbered
            first[vertex] = first[first[vertex]]
    return first


@njit(cache=True, nogil=True, inline="always")
def _find_first(first, vertex):  # type: ignore[no-untyped-def]
    """Find the first vertex of a set so far, and shorten the way to it."""
    while first[vertex] != vertex:
        first[vertex] = first[first[vertex]]
        vertex = first[vertex]
    return vertex


def components_and_euler(vertices: Array, faces: Ints) -> tuple[int, int]:
    """Return the pieces and the Euler number of a closed surface (2 per piece without handles in 3D, 0 in
    2D).
    """
    used, renumbered = used_by(len(vertices), faces)
    count = int(component_labels(int(used.sum()), renumbered).max(initial=-1)) + 1
    n = int(used.sum())
    # a triangle has half of three edges
    return count, n - (len(faces) // 2 if faces.shape[1] == 3 else len(faces))


def component_areas(surface: Surface) -> tuple[Ints, Array]:
    """Return the number (m,) of the connected piece that each face is of, and the areas (k,) of the
    pieces.
    """
    _, piece = np.unique(
        component_labels(len(surface.vertices), surface.faces)[surface.faces[:, 0]], return_inverse=True
    )
    return np.asarray(piece, dtype=np.int64), np.asarray(
        np.bincount(piece, surface.face_areas), dtype=np.float64
    )


def largest_component(vertices: Array, faces: Ints) -> tuple[Array, Ints]:
    """Return the connected piece of a closed surface that encloses most, without the vertices of the
    others.
    """
    label = component_labels(len(vertices), faces)[faces[:, 0]]
    if (label != label[:1]).any():
        corners = vertices[faces] - vertices.mean(axis=0)
        faces = faces[label == np.bincount(label, weights=np.linalg.det(corners)).argmax()]
    used, renumbered = used_by(len(vertices), faces)
    return vertices[used], renumbered
