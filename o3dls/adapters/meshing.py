"""Level set to mesh: Open3D's isosurface, then pymeshlab's repair, light smoothing and decimation; what that
moves is measured.

In 2D the zero set itself is the contour, and nothing needs to be cleaned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Ints
from ..errors import SolverError
from ..geometry.components import component_labels, components_and_euler, largest_component
from ..geometry.flipped_faces import flipped, relaxed
from ..geometry.surface import Surface, interpolated
from ..levelset.grid.distance import SignedDistance
from ..levelset.grid.isosurface import zero_set
from ..levelset.grid.regularised import regularised
from ..parallel import both
from .open3d_module import open3d
from .self_intersections import self_intersections

# pieces with less than this share of the faces of one that is meant are dust, or what a fold has pinched off
LOOSE = 0.1
# spacings: with cells of this size a mesh that is already regularised loses as many faces again
WIDER = 1.15


@dataclass(frozen=True, eq=False)
class Extraction:
    """An extraction is the zero set of a level set as a mesh, with how far the clean-up moved its vertices
    (length).
    """

    surface: Surface
    shift_mean: float
    shift_max: float
    isosurface_faces: int


def extract(
    field: SignedDistance,
    *,
    smoothing: int = 3,
    keep: float = 0.5,
    islands: bool = True,
    smallest: float = 1.0,
    raw: Surface | None = None,
) -> Extraction:
    """Extract the surface phi = 0, wound outward. smoothing: Taubin passes; keep: share of the isosurface's
    faces that decimation leaves; islands: whether pieces beside the largest stay; smallest: the smallest of
    these that is meant, in areas of the largest, of which one with less than a tenth is dust; raw: a mesh of
    the zero set, for where an isosurface of phi has another topology. Smoothing that would make the surface
    cut itself is left out.

    Raises SolverError where phi has no zero set.
    """
    if not ((field.phi < 0.0).any() and (field.phi >= 0.0).any()):
        raise SolverError("the level set has no surface: phi does not change its sign")
    vertices, faces = isosurface(field)
    cell = field.band.spacing
    if raw is None or components_and_euler(vertices, faces) == components_and_euler(raw.vertices, raw.faces):
        raw = Surface(vertices, faces) if islands else Surface(*largest_component(vertices, faces))
        faces = raw.faces
    elif len(raw.faces) < len(faces):
        cell *= WIDER
    if field.band.dimension == 2:
        return Extraction(raw, 0.0, 0.0, len(raw.faces))
    target = int(keep * len(faces))
    # its triangles have a better shape, and fewer faces are decimated faster
    even = regularised(raw, cell) if keep < 1.0 else raw
    start = even if len(even.faces) > target else raw
    # pymeshlab works on one core, the search tree is made on the other
    smooth, tree = both(
        lambda: _clean_mesh(start, smoothing, target, LOOSE * smallest), lambda: raw.closest_point
    )
    mesh = _unfold_mesh(smooth)
    # where two walls are closer than the lattice tells apart
    if smoothing and mesh is smooth and self_intersections(smooth):
        mesh = _unfold_mesh(_clean_mesh(start, 0, target, LOOSE * smallest))
    shift = tree.distance(mesh.vertices)
    return Extraction(mesh, float(shift.mean()), float(shift.max()), len(raw.faces))


def _unfold_mesh(mesh: Surface) -> Surface:
    """Return the mesh relaxed where faces are turned over, as next to cuts, which follow the lattice; as it
    is where the relaxed mesh would cut itself.
    """
    if not flipped(mesh).any():
        return mesh
    even = relaxed(mesh)
    return mesh if self_intersections(even) else even


def isosurface(field: SignedDistance) -> tuple[Array, Ints]:
    """Return vertices and faces of phi = 0, wound outward: flying edges (Open3D) as they come, in 2D the zero
    set itself.
    """
    if field.band.dimension == 2:
        return zero_set(field.band, field.phi)
    o3d = open3d()
    # Open3D's tensors are indexed z, y, x
    box: NDArray[np.float32] = np.ascontiguousarray(field.band.dense(field.phi).T)
    mesh = o3d.t.geometry.TriangleMesh.create_isosurfaces(o3d.core.Tensor.from_numpy(box), [0.0])
    vertices = mesh.vertex.positions.numpy().astype(np.float64) * field.band.spacing + field.band.origin
    return vertices, mesh.triangle.indices.numpy()[:, ::-1]  # Open3D winds towards the smaller values


def _clean_mesh(raw: Surface, smoothing: int, faces: int, loose: float = LOOSE) -> Surface:
    """Repair non-manifold edges, drop dust, smooth lightly (Taubin 1995), decimate by quadrics to so many
    faces; topology is kept.
    """
    import pymeshlab

    largest = np.bincount(component_labels(len(raw.vertices), raw.faces)[raw.faces[:, 0]]).max()
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(raw.vertices, raw.faces.astype(np.int32)))
    meshes.meshing_repair_non_manifold_edges()
    meshes.meshing_remove_connected_component_by_face_number(mincomponentsize=int(loose * largest) + 1)
    if smoothing:
        meshes.apply_coord_taubin_smoothing(stepsmoothnum=smoothing)
    if faces < meshes.current_mesh().face_number():
        meshes.meshing_decimation_quadric_edge_collapse(
            targetfacenum=faces, preservetopology=True, preservenormal=True
        )
    meshes.meshing_remove_unreferenced_vertices()
    mesh = meshes.current_mesh()
    return Surface(mesh.vertex_matrix(), mesh.face_matrix())


def carry_fields(source: Surface, target: Surface) -> Surface:
    """Return the target with the source's fields per vertex, read at the closest points: values never outlive
    a change of mesh unmoved.

    Fields of whole numbers are labels: they are those of the nearest corner, and no mean of two regions.
    """
    from dataclasses import replace

    if not source.fields:
        return target
    _, face, _, weights = source.closest_point.query(target.vertices)
    corners = source.faces[face]
    nearest = np.take_along_axis(corners, weights.argmax(axis=1)[:, None], axis=1)[:, 0]

    def read(values: Array) -> Array:
        if (values == np.round(values)).all():
            return values[nearest]
        return interpolated(values, corners, weights)

    return replace(target, fields={name: read(values) for name, values in source.fields.items()})
