"""Mending folds: where a steep field turned faces over, far from any point, the surface takes the bend of its
surroundings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from ..arrays import Array, Ints, Mask
from .differential import face_normals, neighbours, vertex_normals
from .surface import Surface, crossed_by

# between a face's normal and where its surroundings' rotation took it: beyond 75 degrees it is folding
LEAST_COSINE = 0.25
SURROUNDINGS = 0.3  # rms radii
BLOCK = 2000  # faces whose surroundings are in memory at a time
ENOUGH = 16_000  # vertices: of more, an even part tells how the surroundings turned
SLIVER = 0.01  # longest edges: the height of a face that is no more than a line
ROUNDS = 6  # every round factorises a matrix once, and further rounds mend few faces more
PASSES = 2  # passes of straightening: further ones mend two folded faces in a thousand
MOST_BENT = 0.5  # of the vertices
FEW = 8  # faces: so many more than twice those at first come and go while a patch grows


def uncrossed(outline: Surface) -> Surface:
    """Return the closed line through the same vertices that does not cross itself: between two segments that
    cross, the way is taken backwards (2-opt, Croes 1958), which shortens it, so that this ends. A line of
    several loops stays as it is.
    """
    after = dict(outline.faces.tolist())
    order = [int(outline.faces[0, 0])]
    while after[order[-1]] != order[0] and len(order) < len(after):
        order.append(after[order[-1]])
    if len(order) < len(outline.faces):
        return outline
    outline = _line_through(outline, order)
    k = 0
    while k < len(order):
        crossing = np.flatnonzero(crossed_by(outline, k))
        k += 1
        if len(crossing):
            first, last = sorted((k - 1, int(crossing[0])))
            order[first + 1 : last + 1] = order[first + 1 : last + 1][::-1]
            # earlier segments can cross only the new ones, which are looked at again
            outline = _line_through(outline, order)
            k = first
    return outline if outline.volume > 0.0 else _line_through(outline, order[::-1])


def _line_through(outline: Surface, order: list[int]) -> Surface:
    """Return the closed line through an outline's vertices in an order."""
    return replace(outline, faces=np.column_stack([order, np.roll(order, -1)]))


def repair_folds(rest: Array, moved: Array, faces: Ints, rounds: int = ROUNDS) -> tuple[Array, int, int]:
    """Return the vertices (n, d) moved from `rest` with folds repaired, how many faces had folded, and how
    many are folded still.

    Slivers are straightened. Around other turned faces the displacement is replaced by the one of least
    bending (biharmonic) that continues the surroundings; the patches grow round the faces that are still
    turned until none is, or `rounds` are over: then the round that left fewest counts. They begin with two
    rings, however fine the mesh, end as wide as folds of the wall are, and are at most half of the surface:
    so many systems of so many unknowns are solved, whatever has folded.
    """
    still = _Still.of(rest, faces)
    turned = _find_turned(still, moved, faces)
    count = int(turned.sum())
    if count == 0:
        return moved, 0, 0
    displacement, turned = _straighten_slivers(still, moved - rest, faces, turned)
    best = rest + displacement if turned.sum() < count else moved
    left = int(turned.sum())
    if left == 0:
        return best, count, 0
    patches = _Patches.of(rest, faces)
    zone = np.zeros(len(rest), dtype=bool)
    for k in range(rounds):
        patch = patches.grown(zone, faces[turned], k, rounds)
        # a motion that is replaced in most places no longer comes from the fit
        if patch.sum() > MOST_BENT * len(rest):
            break
        if not (patch & ~zone).any():  # the same faces are turned still: wider around them
            continue
        zone = patch
        patches.bend(displacement, zone)
        turned = _find_turned(still, rest + displacement, faces)
        displacement, turned = _straighten_slivers(still, displacement, faces, turned)
        if turned.sum() < left:
            best = rest + displacement
            left = int(turned.sum())
        # patches that fold ever more would spread over the whole surface
        if left == 0 or turned.sum() > 2 * count + FEW:
            break
    return best, count, left


@dataclass(frozen=True, eq=False)
class _Patches:
    """Patches hold the neighbours of the vertices (n, n), the bending matrix (n, n), and the connected piece
    of each vertex (n,).
    """

    adjacency: Any
    bending: Any
    piece: Ints
    finer: float  # a ring of a fine mesh is narrow

    @classmethod
    def of(cls, rest: Array, faces: Ints) -> _Patches:
        adjacency = neighbours(faces, len(rest))
        laplacian = diags(np.asarray(adjacency.sum(axis=1)).ravel()) - adjacency
        finer = float(np.ceil(np.sqrt(len(rest) / ENOUGH)))
        piece = connected_components(adjacency, directed=False)[1].astype(np.int64)
        return cls(adjacency, csr_matrix(laplacian.T @ laplacian), piece, finer)

    def grown(self, zone: Mask, turned: Ints, k: int, rounds: int) -> Mask:
        """Return the zone (n,) with rings round the corners (m, d) of turned faces, more of them in each
        round k.
        """
        patch = np.zeros(len(zone), dtype=bool)
        patch[turned] = True
        for _ in range(round((2 + k) * self.finer ** (k / max(1, rounds - 1)))):
            patch |= (self.adjacency @ patch.astype(np.float64)) > 0.0
        patch |= zone
        # a piece that has folded as a whole has no surroundings to continue
        return np.asarray(patch & (np.bincount(self.piece, ~patch) > 0.0)[self.piece])

    def bend(self, displacement: Array, zone: Mask) -> None:
        """Replace a displacement (n, d) within a zone (n,) by the one of least bending."""
        inside, outside = np.flatnonzero(zone), np.flatnonzero(~zone)
        rows = self.bending[inside]
        bends = splu(
            rows[:, inside].tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        displacement[inside] = bends.solve(-(rows[:, outside] @ displacement[outside]))


def _straighten_slivers(still: _Still, displacement: Array, faces: Ints, turned: Mask) -> tuple[Array, Mask]:
    """Return the displacement (n, d) whose turned slivers move as their longest edge does, and the faces (m,)
    that are turned then.

    Any bend turns a triangle over whose corners stand nearly in line, though it takes its middle corner by no
    more than the height.
    """
    rest = still.rest
    for _ in range(PASSES * (faces.shape[1] == 3)):
        which = faces[turned]
        corners = rest[which]
        middle = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1), axis=2).argmax(
            axis=1
        )
        own, second, first = (
            np.take_along_axis(which, (middle[:, None] + k) % 3, axis=1)[:, 0] for k in range(3)
        )
        edge, along = rest[second] - rest[first], rest[own] - rest[first]
        share = ((along * edge).sum(axis=1) / np.maximum((edge**2).sum(axis=1), 1e-300))[:, None]
        thin = np.linalg.norm(along - share * edge, axis=1) < SLIVER * np.linalg.norm(edge, axis=1)
        if not thin.any():
            break
        straight = displacement.copy()
        straight[own[thin]] = ((1.0 - share) * displacement[first] + share * displacement[second])[thin]
        fewer = _find_turned(still, rest + straight, faces)
        if fewer.sum() >= turned.sum():
            break
        displacement, turned = straight, fewer
    return displacement, turned


@dataclass(frozen=True, eq=False)
class _Still:
    """This surface is at rest: it has vertices (n, d) relative to its middle and normals of faces (m, d);
    normals and tree of the vertices by which surroundings are told; and its reach.
    """

    rest: Array
    facing: Array
    centred: Array
    normals: Array
    tree: cKDTree
    radius: float

    @classmethod
    def of(cls, rest: Array, faces: Ints) -> _Still:
        step = _sample_step(rest)
        a = rest - rest.mean(axis=0)
        radius = SURROUNDINGS * float(np.sqrt((a**2).sum(axis=1).mean()))
        normals = vertex_normals(rest, faces)[::step]
        return cls(rest, face_normals(rest, faces), a, normals, cKDTree(a[::step]), radius)


def _sample_step(rest: Array) -> int:
    return -(-len(rest) // ENOUGH)


def _find_turned(still: _Still, moved: Array, faces: Ints) -> Mask:
    """Find the faces (m,) that turned over against their surroundings: what turned together has moved, and
    what turned alone is folded.
    """
    before, after = still.facing, face_normals(moved, faces)
    turned = np.asarray(np.einsum("md,md->m", before, after) < LEAST_COSINE)  # the candidates
    which = np.flatnonzero(turned)
    if len(which):
        rotations = _fit_rotations(still, moved, faces[which], before[which])
        carried = np.einsum("nij,nj->ni", rotations, before[which])
        turned[which] = (carried * after[which]).sum(axis=1) < LEAST_COSINE
    return turned


def _fit_rotations(still: _Still, moved: Array, faces: Ints, facing: Array) -> Array:
    """Fit the rotations (k, d, d) by which the surroundings of some faces (k, d), of normals `facing`, went
    from rest to moved (least squares).

    The surroundings are of the same wall, not of the one behind it.
    """
    dim = moved.shape[1]
    step = _sample_step(moved)
    a, b = still.centred, moved - moved.mean(axis=0)
    some = _rotation_moments(a[::step], b[::step])
    corners = faces.ravel()
    sums = _rotation_moments(a[corners], b[corners]).reshape(*faces.shape, -1).sum(axis=1)
    middle = a[faces].mean(axis=1)
    for first in range(0, len(faces), BLOCK):
        block = slice(first, first + BLOCK)
        pairs = cKDTree(middle[block]).sparse_distance_matrix(still.tree, still.radius, output_type="ndarray")
        i, j = pairs["i"], pairs["j"]
        same = (still.normals[j] * facing[block][i]).sum(axis=1) > 0.0
        near = csr_matrix((same.astype(np.float64), (i, j)), shape=(len(middle[block]), len(some)))
        sums[block] += near @ some
    count, mean_a, mean_b, products = np.split(sums, [1, 1 + dim, 1 + 2 * dim], axis=1)
    u, _, vt = np.linalg.svd(
        products.reshape(-1, dim, dim) - (mean_b[:, :, None] * mean_a[:, None, :]) / count[:, :, None]
    )
    u[:, :, -1] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return np.asarray(u @ vt)


def _rotation_moments(a: Array, b: Array) -> Array:
    """Return a row per pair of places a and b (n, d) of the moments from which the rotation of a onto b is
    found.
    """
    return np.column_stack([np.ones(len(a)), a, b, (b[:, :, None] * a[:, None, :]).reshape(len(a), -1)])
