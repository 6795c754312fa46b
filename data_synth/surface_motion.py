"""Families of motion along a surface: as rigid as possible between handles, and inflation by regions."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from o3dls import Surface

from . import wall
from .flow import Bundle
from .sampling import Rows
from .shapes import Array

HANDLES = (6, 10)  # at least, and fewer than
APART = 25.0  # mm between handles: nearer ones that go against each other fold what is between
GRIP = 9.0  # mm: a handle is a ball, so that it holds a vein all around
ROUNDS = 12  # of turning cells and solving for the vertices; far from converged on fine meshes, and the same
TURNED = 0.06  # rad per share, sd per axis of a handle's turn
SOFTENED = 4.0  # mm: the creases about the handles are smoothed over this

REGIONS = (4, 8)
REACH = (14.0, 28.0)  # mm along the surface
BORDER = 5.0  # mm over which borders of regions and normals are smoothed


def arap(rng: np.random.Generator, rest: Surface) -> Bundle:
    """As-rigid-as-possible deformation (Sorkine and Alexa 2007) with cotangent weights.

    Drawn are 6 to 9 handles, balls of 9 mm with middles on the wall, 25 mm apart or more, and for each a
    shift and a turn; every share of the motion is solved anew, from the harmonic interpolation of the
    handles.
    """
    seeds, away = _apart(rng, rest, int(rng.integers(*HANDLES)))
    handle = away.argmin(axis=0)
    held = away.min(axis=0) < GRIP
    shifts = rng.normal(size=(len(seeds), 3))
    turns = TURNED * rng.normal(size=(len(seeds), 3))
    weights = wall.stiffness(rest).tocoo()
    matrix = wall.laplacian(sparse.csr_array(weights))
    solver = splu(matrix[~held][:, ~held].tocsc())
    of, to = (np.asarray(ends, dtype=np.int64) for ends in weights.coords)
    edge = rest.vertices[of] - rest.vertices[to]
    coupling = matrix[~held][:, held]

    def solved(force: Array, fixed: Array) -> Array:
        found = np.empty_like(rest.vertices)
        found[held] = fixed
        found[~held] = solver.solve(force[~held] - coupling @ fixed)
        return np.asarray(found)

    def moved(share: float) -> Array:
        arm = rest.vertices[held] - rest.vertices[seeds[handle[held]]]
        turned = Rotation.from_rotvec(share * turns[handle[held]]).apply(arm) - arm
        shift = share * shifts[handle[held]] + turned
        p = rest.vertices + solved(np.zeros_like(rest.vertices), shift)
        for _ in range(ROUNDS):
            cells = _turned(_summed(of, weights.data, p[of] - p[to], edge, len(p)))
            pull = 0.5 * weights.data[:, None] * np.einsum("eij,ej->ei", cells[of] + cells[to], edge)
            p = solved(_gathered(of, pull, len(p)), rest.vertices[held] + shift)
        return np.asarray(rest.vertices + wall.smoothed(rest, p - rest.vertices, SOFTENED))

    return moved


def regions(rng: np.random.Generator, rest: Surface) -> Bundle:
    """Regions of the wall move in or out along smoothed normals, each by its own amount, with smooth borders.

    Drawn are 4 to 7 middles and, for each, how far it reaches along the surface (14 to 28 mm) and by how
    much, in or out, it moves.
    """
    seeds = rng.choice(len(rest.vertices), rng.integers(*REGIONS), p=_chance(rest), replace=False)
    reach = rng.uniform(*REACH, len(seeds))
    amount = rng.uniform(0.5, 1.5, len(seeds)) * rng.choice([-1.0, 1.0], len(seeds))
    inside = np.clip(1.5 - wall.ways(rest, seeds) / reach[:, None], 0.0, 1.0)  # whole up to half of the reach
    normals = wall.smoothed(rest, rest.vertex_normals, BORDER)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 0.2)[:, None]  # less where a fold averages out
    shift = wall.smoothed(rest, (amount @ inside)[:, None] * normals, BORDER)
    return lambda share: rest.vertices + share * shift


def _apart(rng: np.random.Generator, rest: Surface, count: int) -> tuple[Rows, Array]:
    """Random vertices (k,) that lie apart from each other, as many as asked for or as there is room for, and
    the distance (k, n) from each to all.
    """
    chance = _chance(rest)
    seeds: list[int] = []
    away = np.zeros((0, len(chance)))
    while len(seeds) < count and chance.any():
        seeds.append(int(rng.choice(len(chance), p=chance / chance.sum())))
        away = np.vstack([away, np.linalg.norm(rest.vertices - rest.vertices[seeds[-1]], axis=1)])
        chance = np.where(away[-1] < APART, 0.0, chance)
    return np.array(seeds), away


def _chance(surface: Surface) -> Array:
    areas = wall.vertex_areas(surface)
    return np.asarray(areas / areas.sum())


def _gathered(of: Rows, values: Array, n: int) -> Array:
    """Sums (n, k) of values (e, k) over the edges that leave each vertex."""
    return np.column_stack([np.bincount(of, column, n) for column in values.T])


def _summed(of: Rows, weights: Array, now: Array, rest: Array, n: int) -> Array:
    """Covariance (n, 3, 3) of the edges about each vertex, as they are now by what they were at rest."""
    outer = weights[:, None, None] * now[:, :, None] * rest[:, None, :]
    return _gathered(of, outer.reshape(-1, 9), n).reshape(n, 3, 3)


def _turned(covariance: Array) -> Array:
    """The rotations (n, 3, 3) nearest to matrices."""
    u, _, vt = np.linalg.svd(covariance)
    u[:, :, 2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))[:, None]
    return np.asarray(u @ vt)
