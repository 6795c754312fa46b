"""Exact closest points on triangles (3D) or segments (2D), by a tree that follows a moving surface."""

from __future__ import annotations

from copy import copy
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ..arrays import Array, Ints
from ..parallel import axes_of, by_rows
from .bounding_box_tree import box_gap, corners_and_boxes, median_order

WORTH = 500  # points that are worth a thread
STACK = 128  # nodes of a tree that wait at most: more than any tree is deep
LEAF = 4  # faces per leaf: fewer deepen the tree, more test triangles in vain


class FaceTree(NamedTuple):
    """A tree of faces has their corners (m, 3, 3) in its own order, the number of leaves that hold them, and
    the boxes (2 leaves - 1, 2, 3) of its nodes.
    """

    corners: Array
    leaves: int
    boxes: Array


class Nearest(NamedTuple):
    """Nearest to each point are, at this squared distance (k,), a face (k,), a place in it (k, 3) and that
    place's weights (k, 3).
    """

    squared: Array
    face: Ints
    feet: Array
    weights: Array


class ClosestPoint:
    """This search finds the closest points on a surface of vertices (n, d) and faces (m, d).

    `at` follows moved vertices without rebuilding the tree. Inside, a segment of the plane is a triangle in
    space whose last two corners coincide, so that one kernel serves both.
    """

    def __init__(self, vertices: Array, faces: Ints) -> None:
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self.leaves = 1 << max(0, int(np.ceil(np.log2(len(faces) / LEAF))))
        self.order = median_order(np.ascontiguousarray(vertices[self.faces].mean(axis=1).T), self.leaves)
        self.rank = np.argsort(self.order)
        self.in_order = self.faces[self.order]
        self._place_tree(vertices)

    def at(self, vertices: Array) -> ClosestPoint:
        """Return this surface at new vertex positions (n, d).

        Exact for any motion, fastest while neighbours stay neighbours.
        """
        moved = copy(self)
        moved._place_tree(vertices)
        return moved

    def _place_tree(self, vertices: Array) -> None:
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.corners, self.boxes = corners_and_boxes(
            axes_of(vertices), self.vertices, self.in_order, self.leaves
        )
        self.face_tree = FaceTree(self.corners, self.leaves, self.boxes)

    def query(
        self, points: Array, bound: float = np.inf, hint: Ints | None = None
    ) -> tuple[Array, Ints, Array, Array]:
        """Return the squared distance (k,), face (k,), closest point (k, d) and barycentric weights (k, d) in
        that face.

        Points are (k, d). Beyond `bound` (a length) the face is -1 and the distance infinite. `hint` (k,)
        names faces that are probably near, such as those of the last query of an iteration: it halves the
        time and changes nothing but the choice between faces equally near.
        """
        n, d = points.shape
        spatial = np.zeros((n, 3))
        spatial[:, :d] = points
        guess = np.full(n, -1) if hint is None else self.rank[hint]
        none = np.full(n, np.inf), np.full(n, -1), np.full((n, 3), np.nan), np.zeros((n, 3))

        def fill(points: Array, guess: Ints, *rows: Any) -> None:
            _query_points(points, guess, Nearest(*rows), self.face_tree, bound * bound)

        by_rows(fill, WORTH, (spatial, guess, *none))
        squared, found, feet, weights = none
        return squared, np.where(found < 0, -1, self.order[found]), feet[:, :d], weights[:, :d]

    def distance(self, points: Array) -> Array:
        """Return the unsigned distance (k,) of points (k, d)."""
        return np.asarray(np.sqrt(self.query(points)[0]))


@njit(cache=True, nogil=True)
def _second_and_third(second, third, place):  # type: ignore[no-untyped-def]
    """Return the barycentric weights of the second and third corner at the closest point, by Voronoi regions.

    Ericson, Real-Time Collision Detection, 5.1.5; corners and point (3 numbers each) relative to the first
    corner. Tuples, because array views cost more than the sums.
    """
    bx, by, bz = second
    cx, cy, cz = third
    x, y, z = place
    d1 = bx * x + by * y + bz * z
    d2 = cx * x + cy * y + cz * z
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, cx * cx + cy * cy + cz * cz
    d3, d4 = d1 - bb, d2 - bc
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and bb > 0.0:
        return d1 / bb, 0.0
    d5, d6 = d1 - bc, d2 - cc
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / max(cc, 1e-300)  # zero where all corners coincide
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / max((d4 - d3) + (d5 - d6), 1e-300)
        return 1.0 - w, w
    total = va + vb + vc
    return vb / total, vc / total


@njit(cache=True, nogil=True)
def closest_on_face(x, y, z, corners, k):  # type: ignore[no-untyped-def]
    """Return the squared distance of a point from face k, and the weights of its second and third corner."""
    ax, ay, az = corners[k, 0, 0], corners[k, 0, 1], corners[k, 0, 2]
    bx, by, bz = corners[k, 1, 0] - ax, corners[k, 1, 1] - ay, corners[k, 1, 2] - az
    cx, cy, cz = corners[k, 2, 0] - ax, corners[k, 2, 1] - ay, corners[k, 2, 2] - az
    v, w = _second_and_third((bx, by, bz), (cx, cy, cz), (x - ax, y - ay, z - az))
    gx, gy, gz = x - ax - v * bx - w * cx, y - ay - v * by - w * cy, z - az - v * bz - w * cz
    return gx * gx + gy * gy + gz * gz, v, w


@njit(cache=True, nogil=True)
def nearest_face(place, guess, limit, tree, waiting):  # type: ignore[no-untyped-def]
    """Return the nearest face to a place whose squared distance is within `limit`, or -1; that distance, and
    the weights of the face's second and third corner. The search begins with the face `guess`, unless -1.
    waiting: room for nodes that wait, and for their squared distances, STACK each.
    """
    x, y, z = place
    corners, leaves, boxes = tree
    stack, stack_gap = waiting
    m = corners.shape[0]
    best = -1
    best_v = 0.0
    best_w = 0.0
    if guess >= 0:
        gap, v, w = closest_on_face(x, y, z, corners, guess)
        if gap <= limit:
            limit = gap
            best = guess
            best_v = v
            best_w = w
    stack[0] = 0
    stack_gap[0] = box_gap(x, y, z, boxes, 0)
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if stack_gap[top] > limit:
            continue
        while node < leaves - 1:  # down the nearer side; the farther waits
            near, far = 2 * node + 1, 2 * node + 2
            gap_near, gap_far = box_gap(x, y, z, boxes, near), box_gap(x, y, z, boxes, far)
            if gap_far < gap_near:
                near, far, gap_near, gap_far = far, near, gap_far, gap_near
            if gap_far <= limit:
                stack[top], stack_gap[top] = far, gap_far
                top += 1
            if gap_near > limit:
                break
            node = near
        if node < leaves - 1:
            continue
        leaf = node - (leaves - 1)
        for k in range(leaf * m // leaves, (leaf + 1) * m // leaves):
            gap, v, w = closest_on_face(x, y, z, corners, k)
            if gap < limit or (gap == limit and best < 0):
                limit, best, best_v, best_w = gap, k, v, w
    return best, limit, best_v, best_w


@njit(cache=True, nogil=True)
def _query_points(points, guess, nearest, tree, bound2):  # type: ignore[no-untyped-def]
    """Fill in what is nearest to each point, where something is near enough."""
    waiting = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    corners, weights = tree.corners, nearest.weights
    for i in range(points.shape[0]):
        place = points[i, 0], points[i, 1], points[i, 2]
        best, gap, v, w = nearest_face(place, guess[i], bound2, tree, waiting)
        if best >= 0:
            nearest.squared[i], nearest.face[i] = gap, best
            weights[i, 0] = 1.0 - v - w
            weights[i, 1] = v
            weights[i, 2] = w
            for axis in range(3):
                nearest.feet[i, axis] = (
                    weights[i, 0] * corners[best, 0, axis]
                    + v * corners[best, 1, axis]
                    + w * corners[best, 2, axis]
                )
