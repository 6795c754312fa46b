"""A real surface before it moves: read whole, ways along it, its Laplacian, far places, folds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import splu

from o3dls import InputError, Surface, read_surface

from .sampling import Mask, Rows
from .shapes import Array

REACH = 1.9  # radii
EVENED = 10  # rounds
MENDED = 30
LEAST_COTANGENT = 1e-3  # of the Laplacian's weights: slivers make cotangents of any sign


def read_wall(path: str | Path, reach: float | None = REACH) -> Surface:
    """The largest piece of the surface in a file, its vessels cut where they are farther from the centre than
    `reach` radii (see `body`; None: whole), as a lab leaves them out. Raises InputError where it is no closed
    surface in 3D.
    """
    surface = read_surface(path)
    if surface.dimension != 3 or not surface.watertight or surface.volume <= 0.0:
        raise InputError(f"{path}: must be a closed surface in 3D, wound outwards")
    surface = largest(surface)
    centre, radius = body(surface)
    far = np.linalg.norm(surface.vertices - centre, axis=1).max()
    return mended(surface if reach is None or far <= reach * radius else cut(surface, centre, reach * radius))


def mended(surface: Surface) -> Surface:
    """The surface, its vertices evened out about faces that cut through others, until none does or 30 rounds
    have not helped.
    """
    mean = edges(surface) > 0.0
    mean = sparse.diags_array(1.0 / mean.sum(axis=1)) @ mean
    for _ in range(MENDED):
        if not (bad := crosses(surface)).any():
            break
        about = np.zeros(len(surface.vertices))
        about[surface.faces[bad]] = 1.0
        share = np.minimum(mean @ about + about, 1.0)[:, None]
        surface = surface.with_vertices((1.0 - share) * surface.vertices + share * (mean @ surface.vertices))
    return surface


def largest(surface: Surface) -> Surface:
    """The piece with the most faces."""
    _, piece = connected_components(edges(surface))
    of_face = piece[surface.faces[:, 0]]
    return Surface(surface.vertices, surface.faces[of_face == np.bincount(of_face).argmax()]).without_unused()


def cut(surface: Surface, centre: Array, reach: float) -> Surface:
    """What of a closed surface hangs together within a ball; every hole is closed by a fan about its middle,
    its rim evened.
    """
    near = np.linalg.norm(surface.vertices - centre, axis=1) <= reach
    kept = largest(Surface(surface.vertices, surface.faces[near[surface.faces].all(axis=1)]))
    while len(pinched := _pinched(kept)):  # faces about a vertex that two rims share
        kept = largest(Surface(kept.vertices, kept.faces[~np.isin(kept.faces, pinched).any(axis=1)]))
    vertices, faces = [kept.vertices.copy()], [kept.faces]
    for rim in _rims(kept):
        at = vertices[0][rim]
        for _ in range(EVENED):
            at = 0.5 * at + 0.25 * (np.roll(at, 1, axis=0) + np.roll(at, -1, axis=0))
        vertices[0][rim] = at
        top = sum(map(len, vertices))
        vertices.append(at.mean(axis=0, keepdims=True))
        faces.append(np.column_stack([np.roll(rim, -1), rim, np.full(len(rim), top)]))
    return Surface(np.vstack(vertices), np.vstack(faces))


def _open_edges(surface: Surface) -> NDArray[np.int64]:
    """Directed edges (k, 2) that no face has the other way."""
    a = surface.faces.ravel()
    b = np.roll(surface.faces, -1, axis=1).ravel()
    n = len(surface.vertices)
    lone = ~np.isin(a * n + b, b * n + a)
    return np.column_stack([a[lone], b[lone]])


def _pinched(surface: Surface) -> Rows:
    """Vertices that are on more than one rim."""
    return np.flatnonzero(np.bincount(_open_edges(surface)[:, 0], minlength=1) > 1)


def _rims(surface: Surface) -> list[Rows]:
    """Vertices of every hole, in the order of its edges."""
    follows = dict(_open_edges(surface).tolist())
    rims = []
    while follows:
        rim = list(follows.popitem())
        while (last := follows.pop(rim[-1])) != rim[0]:
            rim.append(last)
        rims.append(np.array(rim))
    return rims


def body(surface: Surface) -> tuple[Array, float]:
    """Centre of mass (3,) of a closed surface, and the radius (mm) of the ball of its volume."""
    corners = surface.vertices[surface.faces]
    volume = np.linalg.det(corners) / 6.0
    centre = (volume[:, None] * corners.sum(axis=1) / 4.0).sum(axis=0) / volume.sum()
    return centre, float(np.cbrt(0.75 / np.pi * volume.sum()))


def edges(surface: Surface) -> sparse.csr_array:
    """Length of every edge as a symmetric matrix (n, n)."""
    a = surface.faces.ravel()
    b = np.roll(surface.faces, -1, axis=1).ravel()
    length = np.linalg.norm(surface.vertices[a] - surface.vertices[b], axis=1)
    return sparse.csr_array((length, (a, b)), shape=(len(surface.vertices),) * 2)


def ways(surface: Surface, sources: Rows) -> Array:
    """Way (k, n) along the edges from each of k vertices to all."""
    return np.asarray(dijkstra(edges(surface), indices=sources))


def far_places(surface: Surface, count: int, among: Mask | None = None) -> Rows:
    """Vertices (count,) that lie far from each other along the surface: first the one farthest from the
    middle, then each the farthest from those before; only such as are `among` (n,), if given.
    """
    among = np.ones(len(surface.vertices), dtype=bool) if among is None else among
    away = np.linalg.norm(surface.vertices - surface.vertices.mean(axis=0), axis=1)
    chosen = [int(np.where(among, ways(surface, np.array([away.argmin()]))[0], -1.0).argmax())]
    nearest = ways(surface, np.array(chosen))[0]
    while len(chosen) < count:
        chosen.append(int(np.where(among, nearest, -1.0).argmax()))
        nearest = np.minimum(nearest, ways(surface, np.array(chosen[-1:]))[0])
    return np.array(chosen)


def vertex_areas(surface: Surface) -> Array:
    """Area (n,) that belongs to each vertex: a third of its faces."""
    shares = np.repeat(surface.face_areas / 3.0, 3)
    return np.bincount(surface.faces.ravel(), shares, len(surface.vertices)).astype(np.float64)


def stiffness(surface: Surface) -> sparse.csr_array:
    """Cotangent weights of the edges as a symmetric matrix (n, n), none of them negative."""
    n = len(surface.vertices)
    total = sparse.csr_array((n, n))
    for k in range(3):
        corner, a, b = (surface.faces[:, (k + j) % 3] for j in range(3))
        u, v = surface.vertices[a] - surface.vertices[corner], surface.vertices[b] - surface.vertices[corner]
        sine = np.maximum(np.linalg.norm(np.cross(u, v), axis=1), 1e-12)
        half = sparse.csr_array((0.5 * (u * v).sum(axis=1) / sine, (a, b)), shape=(n, n))
        total = total + half + half.T
    total.data = np.maximum(total.data, LEAST_COTANGENT)
    return sparse.csr_array(total)


def laplacian(weights: sparse.csr_array) -> sparse.csr_array:
    """Positive semidefinite Laplacian of symmetric weights (n, n)."""
    return sparse.csr_array(sparse.diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights)


def smoothed(surface: Surface, values: Array, length: float) -> Array:
    """Values (n, k) per vertex after diffusion along the surface over a length."""
    mass = sparse.diags_array(vertex_areas(surface))
    system = mass + length**2 * laplacian(stiffness(surface))
    return np.asarray(splu(system.tocsc()).solve(np.asarray(mass @ values)))


def flipped(rest: Surface, moved: Array) -> int:
    """Number of faces that look the other way than at rest, once the vertices (n, 3) have moved."""
    now = rest.with_vertices(moved).face_normals
    return int(((now * rest.face_normals).sum(axis=1) <= 0.0).sum())


def crosses(surface: Surface) -> NDArray[np.bool_]:
    """Which faces (m,) cut through others."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.vertices, surface.faces.astype(np.int32)))
    meshes.compute_selection_by_self_intersections_per_face()
    return np.asarray(meshes.current_mesh().face_selection_array(), dtype=bool)
