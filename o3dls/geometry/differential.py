"""Normals and mean curvature of a moving simplicial surface, compiled, since every step needs them afresh;
and its vertices' graph.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.sparse import coo_matrix, csr_matrix

from ..arrays import Array, Ints
from ..parallel import axes_of

FLAT = 1e-6  # height over length of a face below which its corners count as in line


def normals_and_curvature(
    vertices: Array, faces: Ints, limit: float, smoothing: int = 3
) -> tuple[Array, Array]:
    """Return unit vertex normals (n, d) and the sum of principal curvatures (n,), positive on a sphere,
    within [-limit, limit] (1/length).

    Curvature is the trace of the shape operator fitted to the normals of each face (Rusinkiewicz 2004),
    averaged over rings.
    """
    normals, area_vectors = _vertex_normals(vertices, faces)
    return normals, _mean_curvature(vertices, faces, normals, area_vectors, limit, smoothing)


def vertex_normals(vertices: Array, faces: Ints) -> Array:
    """Return area-weighted unit vertex normals (n, d)."""
    return np.asarray(_vertex_normals(vertices, faces)[0])


def face_normals(vertices: Array, faces: Ints) -> Array:
    """Return unit normals (m, d) of the faces; zero where a face has no area."""
    areas = _vertex_normals(vertices, faces)[1]
    return np.asarray(areas / np.maximum(np.sqrt(np.einsum("md,md->m", areas, areas)), 1e-300)[:, None])


def facing(vertices: Array, faces: Ints, normals: Array) -> float:
    """Return the share of a surface's area that is left when each face counts by how far it looks along unit
    normals (n, d) given at the vertices.
    """
    areas = _vertex_normals(vertices, faces)[1]
    along = np.einsum("md,mcd->", areas, normals[faces]) / faces.shape[1]
    return float(along / np.sqrt(np.einsum("md,md->m", areas, areas)).sum())


def stretches(rest: Array, moved: Array, faces: Ints) -> Array:
    """Return the largest factor (m,) by which each face gets longer in any direction, from one position (n,
    d) of the vertices to another.
    """
    g, h = (
        np.einsum("mid,mjd->mij", edges, edges)
        for edges in (at[faces[:, 1:]] - at[faces[:, :1]] for at in (rest, moved))
    )
    if faces.shape[1] == 2:
        return np.asarray(np.sqrt(h[:, 0, 0] / np.maximum(g[:, 0, 0], 1e-300)))
    long, longer = (np.maximum(x[:, 0, 0] + x[:, 1, 1], 1e-300) for x in (g, h))
    # the squared areas, times four
    area, now = (np.maximum(x[:, 0, 0] * x[:, 1, 1] - x[:, 0, 1] ** 2, 1e-300) for x in (g, h))
    flat = area < (FLAT * long) ** 2  # what rounding leaves of it says nothing, but how long it is does
    area = np.where(flat, long**2, area)
    half = 0.5 * (h[:, 0, 0] * g[:, 1, 1] - 2.0 * h[:, 0, 1] * g[:, 0, 1] + h[:, 1, 1] * g[:, 0, 0]) / area
    most = half + np.sqrt(np.maximum(half**2 - now / area, 0.0))
    return np.asarray(np.sqrt(np.where(flat, longer / long, most)))


def unit_mean(vectors: Array, corner: Ints, bary: Array) -> Array:
    """Return unit vectors (k, d): vectors (n, d) of the vertices, interpolated at corners (k, d) with
    barycentric weights (k, d).
    """
    mean = (vectors[corner] * bary[:, :, None]).sum(axis=1)
    return np.asarray(mean / np.maximum(np.linalg.norm(mean, axis=1), 1e-300)[:, None])


def _vertex_normals(vertices: Array, faces: Ints) -> tuple[Array, Array]:
    """Return unit vertex normals (n, d) and area vectors (m, d) of the faces."""
    normals, areas = _sum_face_areas(axes_of(vertices), vertices, faces)
    return normals, areas


@njit(cache=True, nogil=True)
def _sum_face_areas(axes, vertices, faces):  # type: ignore[no-untyped-def]
    n, dim = len(vertices), len(axes)
    total = np.zeros((n, dim))
    areas = np.empty((len(faces), dim))
    for f in range(len(faces)):
        a = faces[f, 0]
        b = faces[f, 1]
        c = faces[f, dim - 1]
        if dim == 2:
            areas[f, 0], areas[f, 1] = vertices[b, 1] - vertices[a, 1], vertices[a, 0] - vertices[b, 0]
        else:
            ux, uy, uz = (
                vertices[b, 0] - vertices[a, 0],
                vertices[b, 1] - vertices[a, 1],
                vertices[b, 2] - vertices[a, 2],
            )
            vx, vy, vz = (
                vertices[c, 0] - vertices[a, 0],
                vertices[c, 1] - vertices[a, 1],
                vertices[c, 2] - vertices[a, 2],
            )
            areas[f, 0], areas[f, 1], areas[f, 2] = (
                0.5 * (uy * vz - uz * vy),
                0.5 * (uz * vx - ux * vz),
                0.5 * (ux * vy - uy * vx),
            )
        for corner in range(dim):
            for k in range(dim):
                total[faces[f, corner], k] += areas[f, k]
    for i in range(n):
        length = 0.0
        for k in range(dim):
            length += total[i, k] ** 2
        length = np.sqrt(length) + 1e-300
        for k in range(dim):
            total[i, k] /= length
    return total, areas


@njit(cache=True, nogil=True)
def _mean_curvature(vertices, faces, normals, areas, limit, smoothing):  # type: ignore[no-untyped-def]
    n, dim = vertices.shape
    value = np.zeros(n)
    weight = np.full(n, 1e-300)
    for f in range(faces.shape[0]):
        a, b = faces[f, 0], faces[f, 1]
        ee = en = 0.0
        area = 0.0
        for k in range(dim):
            e = vertices[b, k] - vertices[a, k]
            ee += e * e
            en += e * (normals[b, k] - normals[a, k])
            area += areas[f, k] ** 2
        area = np.sqrt(area)
        trace = en / max(ee, 1e-300)
        if dim == 3:
            c = faces[f, 2]
            gg = eg = gn = mixed = 0.0
            for k in range(3):
                e, g = vertices[b, k] - vertices[a, k], vertices[c, k] - vertices[a, k]
                gg += g * g
                eg += e * g
                gn += g * (normals[c, k] - normals[a, k])
                mixed += 0.5 * (e * (normals[c, k] - normals[a, k]) + g * (normals[b, k] - normals[a, k]))
            trace = (gg * en - 2.0 * eg * mixed + ee * gn) / max(ee * gg - eg * eg, 1e-300)
        for corner in range(dim):
            value[faces[f, corner]] += trace * area
            weight[faces[f, corner]] += area
    value = np.minimum(np.maximum(value / weight, -limit), limit)
    for _ in range(smoothing):  # a face's mean is every vertex's neighbour: three rounds reach three rings
        total = np.zeros(n)
        count = np.full(n, 1e-300)
        for f in range(faces.shape[0]):
            mean = 0.0
            for corner in range(dim):
                mean += value[faces[f, corner]] / dim
            for corner in range(dim):
                total[faces[f, corner]] += mean
                count[faces[f, corner]] += 1.0
        value = total / count
    return value


def evened(vertices: Array, faces: Ints, rounds: int = 8) -> Array:
    """Return the vertices (n, d) moved along their surface towards the mean of their neighbours: a lattice's
    slivers become triangles.

    Slivers turn over in any motion, and where they meet, a mean over neighbours is none over the surface.
    """
    adjacency = neighbours(faces, len(vertices))
    valence = np.asarray(adjacency.sum(axis=1))
    for _ in range(rounds):
        step = adjacency @ vertices / valence - vertices
        normals = vertex_normals(vertices, faces)
        vertices = vertices + 0.5 * (step - (step * normals).sum(axis=1, keepdims=True) * normals)
    return np.asarray(vertices)


def neighbours(faces: Ints, count: int) -> csr_matrix:
    """Return the symmetric 0/1 matrix (n, n) of vertices that share an edge."""
    a = faces.ravel()
    b = np.roll(faces, -1, axis=1).ravel()
    both = coo_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(count, count)).tocsr()
    both.data[:] = 1.0
    return csr_matrix(both)
