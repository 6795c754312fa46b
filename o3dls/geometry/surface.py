"""Closed or open surfaces in two and three dimensions: polylines and triangle meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Ints, masked_in
from ..errors import InputError
from .similarity import apply

if TYPE_CHECKING:
    from .closest_point import ClosestPoint


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface is a closed or open simplicial one: triangles in 3D, segments in 2D, wound so that normals
    point outward.

    vertices (n, d) in the case's units; faces (m, d), 0-based; fields: values per vertex, each (n,) or (n,
    k). Raises InputError where shapes, lengths or indices do not fit, or a coordinate is not finite.
    """

    vertices: Array
    faces: Ints
    fields: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        faces = np.asarray(self.faces)
        for part in (self.vertices, self.faces):
            if masked_in(part) is not None:
                raise InputError("surface vertices or faces are masked: give those that are there alone")
        object.__setattr__(self, "vertices", np.ascontiguousarray(self.vertices, dtype=np.float64))
        object.__setattr__(self, "faces", np.ascontiguousarray(faces, dtype=np.int64))
        if self.vertices.ndim != 2 or self.vertices.shape[1] not in (2, 3):
            raise InputError(f"surface vertices have shape {self.vertices.shape}: must be (n, 2) or (n, 3)")
        if self.faces.ndim != 2 or self.faces.shape[1] != self.dimension or len(self.faces) == 0:
            raise InputError(
                f"surface faces have shape {self.faces.shape}: must be (m, {self.dimension}) with m > 0"
            )
        if not np.isfinite(self.vertices).all():
            row = int(np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))[0])
            raise InputError(f"surface vertex {row} is not finite: {self.vertices[row]}")
        wrong = faces[(faces < 0) | (faces >= len(self.vertices)) | (faces != self.faces)]
        if len(wrong):
            raise InputError(
                f"surface faces name vertex {wrong[0]:.12g}: there are {len(self.vertices)}, counted from 0"
            )
        for name, values in self.fields.items():
            if np.shape(values)[:1] != (len(self.vertices),):
                raise InputError(
                    f"surface field '{name}' has shape {np.shape(values)}: there are "
                    f"{len(self.vertices)} vertices"
                )

    def __repr__(self) -> str:
        fields = f", fields {', '.join(self.fields)}" if self.fields else ""
        return f"Surface({len(self.vertices)} vertices, {len(self.faces)} faces{fields})"

    @property
    def dimension(self) -> int:
        return int(self.vertices.shape[1])

    @cached_property
    def face_area_vectors(self) -> Array:
        """Outward normals scaled by area (3D) or length (2D), (m, d)."""
        corners = self.vertices[self.faces]
        edge = corners[:, 1] - corners[:, 0]
        if self.dimension == 2:  # a counter-clockwise outline has its outside on the right
            return np.column_stack([edge[:, 1], -edge[:, 0]])
        return np.asarray(0.5 * np.cross(edge, corners[:, 2] - corners[:, 0]))

    @cached_property
    def face_areas(self) -> Array:
        return np.asarray(np.linalg.norm(self.face_area_vectors, axis=1))

    @cached_property
    def face_normals(self) -> Array:
        return np.asarray(self.face_area_vectors / np.maximum(self.face_areas, 1e-300)[:, None])

    @cached_property
    def vertex_normals(self) -> Array:
        """Area-weighted unit normals, (n, d); zero at vertices without a face."""
        total = np.zeros_like(self.vertices)
        np.add.at(total, self.faces.ravel(), np.repeat(self.face_area_vectors, self.dimension, axis=0))
        return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None])

    @cached_property
    def vertex_areas(self) -> Array:
        """Each vertex's share (n,) of the area of its faces; the shares add up to the area."""
        of_corner = np.repeat(self.face_areas / self.dimension, self.dimension)
        return np.asarray(np.bincount(self.faces.ravel(), of_corner, len(self.vertices)), dtype=np.float64)

    @cached_property
    def closest_point(self) -> ClosestPoint:
        """The tree by which closest points are found, made once for all that is measured on the surface."""
        from .closest_point import ClosestPoint  # imported here, so that reading a file does not compile code

        return ClosestPoint(self.vertices, self.faces)

    @property
    def area(self) -> float:
        return float(self.face_areas.sum())

    @property
    def volume(self) -> float:
        """Enclosed volume (3D) or area (2D), positive for outward winding; only meaningful where
        watertight.
        """
        corners = self.vertices[self.faces[:, 0]] - self.vertices.mean(axis=0)
        return float((corners * self.face_area_vectors).sum() / self.dimension)

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @cached_property
    def watertight(self) -> bool:
        """True where every edge (3D) or vertex (2D) is shared by exactly two faces, once in each
        direction.
        """
        if self.dimension == 2:
            starts, ends = (np.bincount(self.faces[:, k], minlength=len(self.vertices)) for k in (0, 1))
            return bool((starts == ends).all() and (starts <= 1).all())
        n = len(self.vertices)
        a = self.faces.ravel()
        b = np.roll(self.faces, -1, axis=1).ravel()
        forward, backward = np.sort(a * n + b), np.sort(b * n + a)
        return bool((forward == backward).all() and (np.diff(forward) > 0).all())

    def without_unused(self) -> Surface:
        """Return the surface without vertices that no face uses: they lie on no wall, but have a say in sizes
        and means. Itself without any.
        """
        used, faces = used_by(len(self.vertices), self.faces)
        return (
            self
            if used.all()
            else Surface(
                self.vertices[used], faces, {name: values[used] for name, values in self.fields.items()}
            )
        )

    def with_vertices(self, vertices: Array) -> Surface:
        """Return this surface's connectivity and fields at other positions."""
        return replace(self, vertices=vertices)

    def transformed(self, matrix: Array) -> Surface:
        """Return the surface under a (d+1, d+1) homogeneous matrix; a mirroring one flips the winding back to
        outward.
        """
        faces = self.faces[:, ::-1] if np.linalg.det(matrix[:-1, :-1]) < 0 else self.faces
        return replace(self, vertices=apply(matrix, self.vertices), faces=faces)


def used_by(count: int, faces: Ints) -> tuple[NDArray[np.bool_], Ints]:
    """Return which of `count` vertices the faces (m, d) use, and the faces counted in these alone."""
    used = np.zeros(count, dtype=bool)
    used[faces] = True
    return used, (np.cumsum(used) - 1)[faces]


def interpolated(values: Array, corners: Ints, weights: Array) -> Array:
    """Return the values (n, ...) at places of barycentric weights (n, d) among vertices (n, d); one of no
    weight and no value leaves no gap.
    """
    heaviest = np.take_along_axis(corners, weights.argmax(axis=1)[:, None], axis=1)
    return np.asarray(
        np.einsum("nc,nc...->n...", weights, values[np.where(weights == 0.0, heaviest, corners)])
    )


def outline(points: Array) -> Surface:
    """Make a surface of a closed 2D polyline (n, 2), turned counter-clockwise; a repeated last point is
    dropped.
    """
    points = np.asarray(points, dtype=np.float64)
    if len(points) > 1 and np.allclose(points[0], points[-1]):
        points = points[:-1]
    index = np.arange(len(points))
    surface = Surface(points, np.column_stack([index, np.roll(index, -1)]))
    return surface if surface.volume >= 0.0 else Surface(points[::-1], surface.faces)


def crossed_by(outline: Surface, k: int | slice) -> NDArray[np.bool_]:
    """Return which segments (m,) of an outline cross segment k, or (s, m) for a slice of s segments."""
    a, b = outline.vertices[outline.faces.T]
    a_k, b_k = a[k][..., None, :], b[k][..., None, :]
    apart = (_side_of_line(a_k, b_k, a) * _side_of_line(a_k, b_k, b) < 0.0) & (
        _side_of_line(a, b, a_k) * _side_of_line(a, b, b_k) < 0.0
    )
    first, last = outline.faces.T
    neighbours = np.zeros_like(apart)
    for end in outline.faces[k].T:
        neighbours |= (first == end[..., None]) | (last == end[..., None])
    return np.asarray(apart & ~neighbours)


def _side_of_line(a: Array, b: Array, point: Array) -> Array:
    """Return a number that is positive where a point lies left of the line from a to b."""
    edge, to = b - a, point - a
    return np.asarray(edge[..., 0] * to[..., 1] - edge[..., 1] * to[..., 0])
