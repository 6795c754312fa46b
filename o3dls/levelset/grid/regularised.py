"""The zero set with a fourth of its faces and without slivers: regularised marching simplices (Treece, Prager
and Gee 1999).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ...arrays import Array, Ints, Mask
from ...geometry.components import component_labels
from ...geometry.surface import Surface


def regularised(surface: Surface, spacing: float) -> Surface:
    """Return a zero set (`isosurface.zero_set`, 3D, closed) with the mean of the vertices nearest to a node
    of its lattice in their place: closed, manifold, of the same topology. Where a mean would change that,
    they stay.
    """
    faces = surface.faces
    edges = _list_edges(faces)[0]
    group = _near_one_node(surface.vertices, edges, spacing)
    while (bad := _change_topology(faces, edges, group)).any():
        alone = len(bad) + np.arange(len(group))
        group = np.unique(np.where(bad[group], alone, group), return_inverse=True)[1]
    size = np.bincount(group)
    means = np.column_stack([np.bincount(group, along) / size for along in surface.vertices.T])
    return Surface(means, _keep_faces(faces, group))


def _near_one_node(vertices: Array, edges: Ints, spacing: float) -> Ints:
    """Return the group (n,) of each vertex: those that edges connect within the cell around one node, which
    is an end of the edge of a simplex that a vertex lies on.
    """
    return component_labels(len(vertices), _within_cells(vertices, edges, spacing))


@njit(cache=True, nogil=True)
def _within_cells(vertices, edges, spacing):  # type: ignore[no-untyped-def]
    """Return the edges (k, 2) whose ends are nearest to the same node of the lattice."""
    within = np.empty(edges.shape, dtype=edges.dtype)
    found = 0
    for e in range(len(edges)):
        same = True
        for a in range(3):
            same &= np.rint(vertices[edges[e, 0], a] / spacing) == np.rint(vertices[edges[e, 1], a] / spacing)
        if same:
            within[found] = edges[e]
            found += 1
    return within[:found]


def _change_topology(faces: Ints, edges: Ints, group: Ints) -> Mask:
    """Return the groups that cannot become one vertex each: no disk (Euler number 1), at an edge that would
    not have two faces, or of two faces that would be one.
    """
    count = int(group.max()) + 1
    ends, corners = group[edges], group[faces]
    apart = ends[:, 0] != ends[:, 1]
    inner = ends[~apart, 0]
    whole = corners[(corners[:, 0] == corners[:, 1]) & (corners[:, 1] == corners[:, 2]), 0]
    members, within, filled = (np.bincount(part, minlength=count) for part in (group, inner, whole))
    bad: Mask = members - within + filled != 1
    left = _keep_faces(faces, group)
    kept, uses = _list_edges(left)
    bad[kept[uses != 2].ravel()] = True
    needed, found = (_pair_keys(each[:, 0], each[:, 1], count) for each in (ends[apart], kept))
    at = np.minimum(np.searchsorted(found, needed), len(found) - 1)
    bad[ends[apart][found[at] != needed].ravel()] = True
    least, most = left.min(axis=1), left.max(axis=1)
    face = (least * count + left.sum(axis=1) - least - most) * count + most  # groups are far fewer than 2^21
    same, uses = np.unique(face, return_counts=True)
    for corner in (same // count**2, same // count % count, same % count):
        bad[corner[uses > 1]] = True
    # a group of one vertex is no mistake: the groups that it meets are undone
    return np.asarray(bad & (members > 1))


@njit(cache=True, nogil=True)
def _keep_faces(faces, group):  # type: ignore[no-untyped-def]
    """Keep the faces (k, 3) whose corners belong to three groups."""
    left = np.empty(faces.shape, dtype=np.int64)
    found = 0
    for f in range(len(faces)):
        a, b, c = group[faces[f, 0]], group[faces[f, 1]], group[faces[f, 2]]
        if a != b and b != c and c != a:
            left[found, 0], left[found, 1], left[found, 2] = a, b, c
            found += 1
    return left[:found]


def _list_edges(faces: Ints) -> tuple[Ints, Ints]:
    """List the edges (e, 2) in order, the smaller end first, and how many faces (e,) have each."""
    edges, uses = _count_edges(faces, int(faces.max(initial=0)) + 1)
    return edges, uses


@njit(cache=True, nogil=True)
def _count_edges(faces, count):  # type: ignore[no-untyped-def]
    """Write each edge down at its smaller end, where few meet and are soon sorted, and count the faces that
    have it.
    """
    begin = np.zeros(count + 1, dtype=np.int64)
    for f in range(len(faces)):
        for k in range(3):
            begin[min(faces[f, k], faces[f, k - 1]) + 1] += 1
    begin = np.cumsum(begin)
    room = begin[:-1].copy()
    ends = np.empty(3 * len(faces), dtype=np.int64)
    for f in range(len(faces)):
        for k in range(3):
            end, other = max(faces[f, k], faces[f, k - 1]), min(faces[f, k], faces[f, k - 1])
            at = room[other]
            while at > begin[other] and ends[at - 1] > end:
                ends[at] = ends[at - 1]
                at -= 1
            ends[at] = end
            room[other] += 1
    edges = np.empty((len(ends), 2), dtype=np.int64)
    uses = np.zeros(len(ends), dtype=np.int64)
    found = 0
    for other in range(count):
        for at in range(begin[other], begin[other + 1]):
            if at == begin[other] or ends[at] != ends[at - 1]:
                edges[found, 0], edges[found, 1] = other, ends[at]
                found += 1
            uses[found - 1] += 1
    return edges[:found], uses[:found]


def _pair_keys(a: Ints, b: Ints, count: int) -> Ints:
    """Return a number (e,) for each pair of numbers below `count`, the same in either order."""
    return np.asarray(np.minimum(a, b) * count + np.maximum(a, b))
