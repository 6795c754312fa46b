"""Surfaces mended and decimated: what is there twice or inside goes, and it is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Ints
from ..errors import InputError
from ..geometry.surface import Surface
from ..io.meshes.repair import coherent, welded

CLOSE = 1e-6  # of the diagonal: vertices nearer to each other are one, whose places were rounded
RAYS = 48  # from each side of a face; from outside one of them meets nothing
SAMPLES = 60  # faces of a patch that are asked
OFF = 1e-4  # of the diagonal: how far beside a face its rays begin
SEED = 7


def mended(surface: Surface, where: str) -> tuple[Surface, list[str]]:
    """Return the surface with its vertices welded, without faces that are there twice or collapsed, vertices
    without a face, and walls that do not part inside from outside; and a sentence on each change.

    Raises InputError for outlines in 2D, and where nothing is left or edges have still more than two faces.
    """
    if surface.dimension != 3:
        raise InputError(f"{where}: is an outline in 2D; repair is for surfaces in 3D")
    said: list[str] = []
    n, m = len(surface.vertices), len(surface.faces)
    surface = _join_close(welded(surface))
    if (joined := n - len(surface.vertices)) > 0:
        said.append(f"{joined} vertices at the place of another are one with it")
    surface = _without_twins(surface)
    if (twins := m - len(surface.faces)) > 0:
        said.append(f"{twins} faces that are there twice or have no area are left out")
    patch = _patches(surface.faces, len(surface.vertices))
    if patch.max(initial=0) > 0:
        wall = _parts_inside_from_outside(surface, patch)
        if not wall.any():
            raise InputError(f"{where}: no part of it has an inside: is it closed?")
        if (others := int((~wall).sum())) > 0:
            said.append(
                f"{others} faces that do not part inside from outside are left out: inner walls or fins"
            )
        surface = replace(surface, faces=surface.faces[wall])
    used = surface.without_unused()
    if (loose := len(surface.vertices) - len(used.vertices)) > 0:
        said.append(f"{loose} vertices without a face are left out")
    return coherent(used, where), said or ["nothing was to be mended"]


def _join_close(surface: Surface) -> Surface:
    """Return the surface with vertices that are closer than rounding made one, in place of the first."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    n = len(surface.vertices)
    pairs = cKDTree(surface.vertices).query_pairs(CLOSE * surface.diagonal, output_type="ndarray")
    if len(pairs) == 0:
        return surface
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    _, first, group = np.unique(label, return_index=True, return_inverse=True)
    at = first[group]
    return welded(surface.with_vertices(surface.vertices[at]))


def _without_twins(surface: Surface) -> Surface:
    faces = surface.faces
    corners = np.sort(faces, axis=1)
    kept = np.unique(corners, axis=0, return_index=True)[1]
    kept = np.sort(kept[(np.diff(corners[kept], axis=1) > 0).all(axis=1)])
    return replace(surface, faces=faces[kept])


def _patches(faces: Ints, n: int) -> Ints:
    """Return the number (m,) of the patch of each face: patches end where edges have other than two faces."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(a, b) * n + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    _, start, count = np.unique(key[order], return_index=True, return_counts=True)
    owner = np.repeat(np.arange(len(faces)), 3)[order]
    first, second = owner[start[count == 2]], owner[start[count == 2] + 1]
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _parts_inside_from_outside(surface: Surface, patch: Ints) -> NDArray[np.bool_]:
    """Return which faces (m,) are of patches that see the outside on one side alone, told by rays from some
    of their faces.
    """
    random = np.random.default_rng(SEED)
    corners = surface.vertices[surface.faces]
    middle = corners.mean(axis=1)
    area = surface.face_area_vectors
    normal = area / np.maximum(np.linalg.norm(area, axis=1, keepdims=True), 1e-300)
    directions = random.normal(size=(RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    kept = np.zeros(int(patch.max()) + 1, dtype=bool)
    for k in range(len(kept)):
        faces = np.flatnonzero(patch == k)
        some = random.choice(faces, min(SAMPLES, len(faces)), replace=False)
        step = OFF * surface.diagonal * normal[some]
        sides = [_sees_outside(surface, middle[some] + sign * step, directions) for sign in (1.0, -1.0)]
        kept[k] = (sides[0] != sides[1]).mean() > 0.5
    return np.asarray(kept[patch])


def _sees_outside(surface: Surface, places: Array, directions: Array) -> NDArray[np.bool_]:
    """Return from which places (k, 3) one of the rays meets nothing."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    tensor = o3d.core.Tensor.from_numpy
    scene.add_triangles(tensor(surface.vertices.astype(np.float32)), tensor(surface.faces.astype(np.uint32)))
    rays = np.concatenate(
        [np.repeat(places, len(directions), axis=0), np.tile(directions, (len(places), 1))], axis=1
    )
    hit = scene.cast_rays(tensor(rays.astype(np.float32)))["t_hit"].numpy()
    return np.asarray(np.isinf(hit).reshape(len(places), -1).any(axis=1))


def decimated(surface: Surface, faces: int) -> Surface:
    """Decimate to about `faces` triangles by quadric edge collapse that keeps the topology.

    Fields are read at the closest points of the original.
    """
    import pymeshlab

    from .meshing import carry_fields

    if faces < 4 or surface.dimension != 3:
        raise InputError(f"faces = {faces}: only surfaces in 3D are decimated, to at least 4 triangles")
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.vertices, surface.faces.astype(np.int32)))
    meshes.meshing_decimation_quadric_edge_collapse(
        targetfacenum=faces, preservetopology=True, preservenormal=True, preserveboundary=True
    )
    meshes.meshing_remove_unreferenced_vertices()
    mesh = meshes.current_mesh()
    if mesh.face_number() > faces:
        raise InputError(
            f"the surface cannot be decimated to {faces} triangles without changing its topology; "
            f"{mesh.face_number()} are left"
        )
    return carry_fields(surface, welded(Surface(mesh.vertex_matrix(), mesh.face_matrix())))
