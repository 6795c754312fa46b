"""Mending folds: where a steep field turned faces over, far from any point, the surface takes the bend of its surroundings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from ..geometry import Array, Ints, Surface, crossed_by, fit_similarity
from .shape import neighbours, vertex_normals

Mask = NDArray[np.bool_]
LEAST_COSINE = 0.25  # between a face's normal and where its surroundings' rotation took it: beyond 75 degrees it is folding
SURROUNDINGS = 0.3  # rms radii
ENOUGH = 16_000  # vertices: of more, an even part tells how the surroundings turned


def uncrossed(outline: Surface) -> Surface:
    """The closed line through the same vertices that does not cross itself: between two segments that cross, the way is taken backwards
    (2-opt, Croes 1958), which shortens it, so that this ends. A line of several loops stays as it is."""
    after = dict(outline.faces.tolist())
    order = [int(outline.faces[0, 0])]
    while after[order[-1]] != order[0] and len(order) < len(after):
        order.append(after[order[-1]])
    if len(order) < len(outline.faces):
        return outline
    outline, k = _through(outline, order), 0
    while k < len(order):
        crossing = np.flatnonzero(crossed_by(outline, k))
        k += 1
        if len(crossing):
            first, last = sorted((k - 1, int(crossing[0])))
            order[first + 1 : last + 1] = order[first + 1 : last + 1][::-1]
            outline, k = _through(outline, order), 0
    return outline if outline.volume > 0.0 else _through(outline, order[::-1])


def _through(outline: Surface, order: list[int]) -> Surface:
    """The closed line through an outline's vertices in an order."""
    return replace(outline, faces=np.column_stack([order, np.roll(order, -1)]))


def unfold(rest: Array, moved: Array, faces: Ints, rounds: int = 12) -> tuple[Array, int, int]:
    """Vertices (n, d) moved from `rest` with folds mended, how many faces had folded, and how many are folded still.

    Around turned faces the displacement is replaced by the one of least bending (biharmonic) that continues the surroundings;
    the patch grows round the faces that are still turned until none is, or `rounds` are over: then the round that left fewest counts,
    since on a mesh of slivers a patch may fold more than it mends.
    """
    displacement = moved - rest
    turned = _turned(rest, moved, faces)
    count = left = int(turned.sum())
    if count == 0:
        return moved, 0, 0
    best = moved
    adjacency = neighbours(faces, len(rest))
    laplacian = diags(np.asarray(adjacency.sum(axis=1)).ravel()) - adjacency
    bending = csr_matrix(laplacian.T @ laplacian)
    zone = np.zeros(len(rest), dtype=bool)
    for attempt in range(rounds):
        patch = np.zeros(len(rest), dtype=bool)
        patch[faces[turned]] = True
        for _ in range(2 + attempt // 2):
            patch |= (adjacency @ patch.astype(np.float64)) > 0.0
        if not (patch & ~zone).any():  # the same faces are turned still: wider around them
            continue
        zone |= patch
        inside, outside = np.flatnonzero(zone), np.flatnonzero(~zone)
        if len(outside) == 0:
            break
        rows = bending[inside]
        displacement[inside] = spsolve(rows[:, inside].tocsc(), -(rows[:, outside] @ displacement[outside])).reshape(len(inside), -1)
        mended = rest + displacement
        turned = _turned(rest, mended, faces)
        if turned.sum() < left:
            best, left = mended, int(turned.sum())
        if left == 0:
            break
    return best, count, left


def _turned(rest: Array, moved: Array, faces: Ints) -> Mask:
    """Faces (m,) that turned over against their surroundings: what turned together has moved, and what turned alone is folded."""
    before, after = Surface(rest, faces).face_normals, Surface(moved, faces).face_normals
    turned = np.asarray((before * after).sum(axis=1) < LEAST_COSINE)  # all that can have folded
    which = np.flatnonzero(turned)
    if len(which):
        carried = np.einsum("nij,nj->ni", _rotations(rest, moved, faces, which, before[which]), before[which])
        turned[which] = (carried * after[which]).sum(axis=1) < LEAST_COSINE
    return turned


def _rotations(rest: Array, moved: Array, faces: Ints, which: Ints, facing: Array) -> Array:
    """Rotations (k, d, d) by which the surroundings of some faces, of normals `facing`, went from rest to moved (least squares)."""
    dim, own, step = rest.shape[1], faces[which], -(-len(rest) // ENOUGH)
    normals, tree = vertex_normals(rest, faces)[::step], cKDTree(rest[::step])
    radius = SURROUNDINGS * float(np.sqrt(rest.var(axis=0).sum()))
    turns = np.empty((len(which), dim, dim))
    for k, near in enumerate(tree.query_ball_point(rest[own].mean(axis=1), radius, return_sorted=True)):
        here = np.r_[own[k], step * np.asarray(near, dtype=np.int64)[normals[near] @ facing[k] > 0.0]]  # of this wall, not of one behind it
        turns[k] = fit_similarity(rest[here], moved[here], scale=False)[:dim, :dim]
    return turns
