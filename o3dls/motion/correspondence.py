"""Where on the surface each point may have come from.

A mean over all walls within reach of its noise, instead of the closest point.

A point p of noise s comes from the surface element x with probability ~ exp(-|p - x|^2 / 2 s^2) dA. The mean
over these elements needs no correction for curvature (on a sphere it gives the s^2 H / 2 by which noise
carries points outwards), follows bends of the wall within the noise, and where two walls compete it halts
between them instead of locking to one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ..arrays import ROUNDING, TINY, Array, Ints
from ..geometry.bounding_box_tree import box_gap
from ..geometry.closest_point import STACK, ClosestPoint, closest_on_face
from ..geometry.differential import vertex_normals
from ..parallel import axes_of, by_rows
from .field.covariance import Places
from .field.observations import Feet

WORTH, WORTH_FACES = 100, 10_000  # points, and faces, that are worth a thread


class _Faces(NamedTuple):
    """Faces have corners (m, 3, 3) and vertices (m, d). Of the vertices, normals (n, d) are known, and places
    and normals in the reference pose.
    """

    corners: Array
    vertices: Ints
    normals: Array
    rest: Array
    rest_normals: Array


class _Tree(NamedTuple):
    """A tree has leaves, boxes, and what each of its faces and each of its nodes holds (3 d + 4)."""

    leaves: int
    boxes: Array
    centres: Array
    nodes: Array


class _Asked(NamedTuple):
    """Each point has a place (k, 3), squared noise (k,), and the squared distance and the face of its closest
    point (k,); the means (k, 3 d + 2) are filled in.
    """

    points: Array
    sd2: Array
    closest2: Array
    nearest: Ints
    means: Array


def likely_feet(
    tree: ClosestPoint, points: Array, sd: Array, rest: Places, cutoff: float = 3.0, resolution: float = 3.0
) -> Feet:
    """Return the feet of points (k, d) of noise sd (k,) on the tree's surface.

    `rest` are its vertices in the reference pose. cutoff: elements less likely than exp(-cutoff) times the
    closest are left out; resolution: a face whose squared size is smaller than this times the noise is seen
    as its centre. The normals are means of unit normals: shorter where walls of several directions compete,
    and so is what the point tells.
    """
    dim = points.shape[1]
    axes = axes_of(points)
    closest2, nearest, _, _ = tree.query(points)
    normals = vertex_normals(tree.vertices, tree.faces)
    spatial = np.zeros((len(points), 3))
    spatial[:, :dim] = points
    centres = np.empty((len(tree.faces), 3 * dim + 4))
    means = np.zeros((len(points), 3 * dim + 2))
    at_vertices = normals, rest.at, rest.normals

    def fill(corners: Array, vertices: Ints, out: Array) -> None:
        _fill_elements(axes, _Faces(corners, vertices, *at_vertices), out)

    by_rows(fill, WORTH_FACES, (tree.corners, tree.in_order, centres))
    faces = _Faces(tree.corners, tree.in_order, *at_vertices)
    nodes = _Tree(tree.leaves, tree.boxes, centres, _sum_nodes(axes, centres, tree.leaves, tree.boxes))

    def add(*rows: Any) -> None:
        _add_faces(_Asked(*rows), axes, faces, nodes, cutoff, resolution)

    by_rows(add, WORTH, (spatial, sd**2, closest2, tree.rank[nearest], means))
    at, mean, along, height, moved = np.split(means, [dim, 2 * dim, 2 * dim + 1, 2 * dim + 2], axis=1)
    residual = height[:, 0] + (mean * (moved - at)).sum(axis=1)  # from the foot's place in the reference pose
    return Feet(at, mean, along[:, 0], residual)


@njit(cache=True, error_model="numpy", inline="always")
def _write_element(axes, faces, k, share, out):  # type: ignore[no-untyped-def]
    """Write what face k holds at barycentric weights `share`: rest place, normal, its share along the rest
    normal, normal . place, place.
    """
    corners, vertices, normals, rest, rest_normals = faces
    dim = len(axes)
    length = rest_length = agreement = height = 0.0
    for axis in range(dim):
        normal = rest_normal = place = origin = 0.0
        for c in range(dim):
            normal += share[c] * normals[vertices[k, c], axis]
            rest_normal += share[c] * rest_normals[vertices[k, c], axis]
            place += share[c] * corners[k, c, axis]
            origin += share[c] * rest[vertices[k, c], axis]
        out[axis], out[dim + axis], out[2 * dim + 2 + axis] = origin, normal, place
        length += normal * normal
        rest_length += rest_normal * rest_normal
        agreement += normal * rest_normal
        height += normal * place
    length, rest_length = np.sqrt(length) + TINY, np.sqrt(rest_length) + TINY
    for axis in range(dim):
        out[dim + axis] /= length
    out[2 * dim] = agreement / (length * rest_length)
    out[2 * dim + 1] = height / length


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_elements(axes, faces, out):  # type: ignore[no-untyped-def]
    """Fill in what every face holds at its centre, then its measure and its greatest squared edge.

    `out` is (m, 3 d + 4), in tree order.
    """
    corners = faces.corners
    m, dim = len(corners), len(axes)
    share = np.full(dim, 1.0 / dim)
    for k in range(m):
        _write_element(axes, faces, k, share, out[k])
        ux, uy, uz = (
            corners[k, 1, 0] - corners[k, 0, 0],
            corners[k, 1, 1] - corners[k, 0, 1],
            corners[k, 1, 2] - corners[k, 0, 2],
        )
        vx, vy, vz = (
            corners[k, 2, 0] - corners[k, 0, 0],
            corners[k, 2, 1] - corners[k, 0, 1],
            corners[k, 2, 2] - corners[k, 0, 2],
        )
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        edge2 = max(
            ux * ux + uy * uy + uz * uz,
            vx * vx + vy * vy + vz * vz,
            (ux - vx) ** 2 + (uy - vy) ** 2 + (uz - vz) ** 2,
        )
        out[k, 3 * dim + 2] = np.sqrt(edge2) if dim == 2 else 0.5 * np.sqrt(x * x + y * y + z * z)
        out[k, 3 * dim + 3] = edge2


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_nodes(axes, centres, leaves, boxes):  # type: ignore[no-untyped-def]
    """Return what every node of the tree holds: the means of its faces, their measure, and the squared
    diagonal of its box.
    """
    m = len(centres)
    width = 3 * len(axes) + 4
    out = np.zeros((2 * leaves - 1, width))
    for leaf in range(leaves):
        node = leaves - 1 + leaf
        for k in range(leaf * m // leaves, (leaf + 1) * m // leaves):
            for q in range(width - 2):
                out[node, q] += centres[k, width - 2] * centres[k, q]
            out[node, width - 2] += centres[k, width - 2]
    for node in range(leaves - 2, -1, -1):
        for q in range(width - 1):
            out[node, q] = out[2 * node + 1, q] + out[2 * node + 2, q]
    for node in range(2 * leaves - 1):
        share = 1.0 / max(out[node, width - 2], TINY)
        for q in range(width - 2):
            out[node, q] *= share
        for axis in range(3):
            out[node, width - 1] += (boxes[node, 1, axis] - boxes[node, 0, axis]) ** 2
    return out


@njit(cache=True, error_model="numpy", inline="always")
def _add_element(axes, means, points, i, elements, k, closest2, sd2):  # type: ignore[no-untyped-def]
    """Add to row i of the sums what element k holds, times its weight, and return the weight.

    Indices, because array views cost more.
    """
    dim = len(axes)
    gap = 0.0
    for axis in range(dim):
        gap += (points[i, axis] - elements[k, 2 * dim + 2 + axis]) ** 2
    weight = elements[k, 3 * dim + 2] * np.exp(0.5 * (closest2 - gap) / sd2)
    for q in range(3 * dim + 2):
        means[i, q] += weight * elements[k, q]
    for axis in range(dim):
        means[i, 2 * dim + 1] -= weight * elements[k, dim + axis] * points[i, axis]
    return weight


@njit(cache=True, nogil=True, error_model="numpy")
def _add_faces(asked, axes, faces, tree, cutoff, resolution):  # type: ignore[no-untyped-def]
    """Add to the means (n, 3 d + 2) of each point what the faces hold.

    The weights are measure * exp(-squared distance / 2 sd2); the height is that of the point over the face.
    """
    points, sd2, closest2, nearest, means = asked
    leaves, boxes, centres, nodes = tree
    n, m, dim = len(points), len(centres), len(axes)
    size = 3 * dim + 2
    stack = np.empty(STACK, dtype=np.int64)
    share = np.empty(3)
    own = np.empty((1, 3 * dim + 4))
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        limit = closest2[i] * (1.0 + ROUNDING) + 2.0 * cutoff * sd2[i]
        total = 0.0
        stack[0], top = 0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if box_gap(x, y, z, boxes, node) > limit:
                continue
            if nodes[node, 3 * dim + 3] < resolution * sd2[i]:
                total += _add_element(axes, means, points, i, nodes, node, closest2[i], sd2[i])
                continue
            if node < leaves - 1:
                stack[top], stack[top + 1] = 2 * node + 1, 2 * node + 2
                top += 2
                continue
            leaf = node - (leaves - 1)
            for k in range(leaf * m // leaves, (leaf + 1) * m // leaves):
                if centres[k, 3 * dim + 3] < resolution * sd2[i]:
                    total += _add_element(axes, means, points, i, centres, k, closest2[i], sd2[i])
                    continue
                # a face large against the noise is seen at its closest point
                gap, share[1], share[2] = closest_on_face(x, y, z, faces.corners, k)
                if gap > limit:
                    continue
                share[0] = 1.0 - share[1] - share[2]
                if dim == 2:  # a segment is a triangle whose last two corners coincide
                    share[1] += share[2]
                _write_element(axes, faces, k, share, own[0])
                own[0, 3 * dim + 2] = centres[k, 3 * dim + 2]
                total += _add_element(axes, means, points, i, own, 0, closest2[i], sd2[i])
        if total == 0.0:  # all weights underflow far off a sharp edge
            total = 1.0
            for q in range(size):
                means[i, q] = centres[nearest[i], q]
            for axis in range(dim):
                means[i, 2 * dim + 1] -= centres[nearest[i], dim + axis] * points[i, axis]
        for q in range(size):
            means[i, q] /= total
        means[i, 2 * dim + 1] *= -1.0
