"""Exact closest points on triangles (3D) or segments (2D): a bounding-box tree over Morton order that follows a moving surface."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..geometry import Array, Ints

LEAF = 4  # faces per leaf: fewer deepen the tree, more test triangles in vain


class ClosestPoint:
    """Closest points on a surface of vertices (n, d) and faces (m, d); `refit` follows moved vertices without rebuilding the tree."""

    def __init__(self, vertices: Array, faces: Ints) -> None:
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        centres = vertices[self.faces].mean(axis=1)
        self.order = np.argsort(_morton(centres), kind="stable")
        self.leaves = 1 << max(0, int(np.ceil(np.log2(len(faces) / LEAF))))
        self.refit(vertices)

    def refit(self, vertices: Array) -> None:
        """Take new vertex positions (n, d); exact for any motion, fastest while neighbours stay neighbours."""
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.low, self.high = _boxes(self.vertices, self.faces, self.order, self.leaves)

    def query(self, points: Array, bound: float = np.inf) -> tuple[Array, Ints, Array, Array]:
        """Squared distance (k,), face (k,), closest point (k, d) and barycentric weights (k, d) of points (k, d).

        Beyond `bound` (a length) the face is -1 and the distance infinite.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        return _query(points, self.vertices, self.faces, self.order, self.leaves, self.low, self.high, bound * bound)

    def distance(self, points: Array) -> Array:
        """Unsigned distance (k,) of points (k, d)."""
        return np.asarray(np.sqrt(self.query(points)[0]))


def _morton(centres: Array) -> Ints:
    """Interleave the bits of the quantised coordinates, so that faces near in space are near in order."""
    dim = centres.shape[1]
    span = np.maximum(np.ptp(centres, axis=0).max(), 1e-300)
    cells = ((centres - centres.min(axis=0)) / span * 2097151.0).astype(np.int64)  # 21 bits an axis fill 63
    code = np.zeros(len(centres), dtype=np.int64)
    for bit in range(21):
        for axis in range(dim):
            code |= ((cells[:, axis] >> bit) & 1) << (bit * dim + axis)
    return code


@njit(cache=True)
def _boxes(vertices, faces, order, leaves):  # type: ignore[no-untyped-def]
    """Bounding boxes of an implicit binary tree: children of node i are 2i+1 and 2i+2, the leaves come last."""
    m, dim = faces.shape[0], vertices.shape[1]
    low = np.full((2 * leaves - 1, dim), np.inf)
    high = np.full((2 * leaves - 1, dim), -np.inf)
    for leaf in range(leaves):
        node = leaves - 1 + leaf
        for k in range(leaf * m // leaves, (leaf + 1) * m // leaves):
            for corner in range(dim):
                for axis in range(dim):
                    x = vertices[faces[order[k], corner], axis]
                    low[node, axis] = min(low[node, axis], x)
                    high[node, axis] = max(high[node, axis], x)
    for node in range(leaves - 2, -1, -1):
        for axis in range(dim):
            low[node, axis] = min(low[2 * node + 1, axis], low[2 * node + 2, axis])
            high[node, axis] = max(high[2 * node + 1, axis], high[2 * node + 2, axis])
    return low, high


@njit(cache=True)
def _box_distance(p, low, high):  # type: ignore[no-untyped-def]
    total = 0.0
    for axis in range(p.shape[0]):
        gap = max(low[axis] - p[axis], p[axis] - high[axis], 0.0)
        total += gap * gap
    return total


@njit(cache=True)
def _on_segment(p, a, b, weights):  # type: ignore[no-untyped-def]
    along, length = 0.0, 0.0
    for axis in range(p.shape[0]):
        e = b[axis] - a[axis]
        along += (p[axis] - a[axis]) * e
        length += e * e
    t = 0.0 if length == 0.0 else min(1.0, max(0.0, along / length))
    weights[0], weights[1] = 1.0 - t, t


@njit(cache=True)
def _on_triangle(p, a, b, c, weights):  # type: ignore[no-untyped-def]
    """Barycentric weights of the closest point by Voronoi regions (Ericson, Real-Time Collision Detection, 5.1.5)."""
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for axis in range(3):
        ab, ac = b[axis] - a[axis], c[axis] - a[axis]
        d1 += ab * (p[axis] - a[axis])
        d2 += ac * (p[axis] - a[axis])
        d3 += ab * (p[axis] - b[axis])
        d4 += ac * (p[axis] - b[axis])
        d5 += ab * (p[axis] - c[axis])
        d6 += ac * (p[axis] - c[axis])
    weights[0] = weights[1] = weights[2] = 0.0
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        weights[0] = 1.0
    elif d3 >= 0.0 and d4 <= d3:
        weights[1] = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        weights[1] = d1 / max(d1 - d3, 1e-300)  # zero where two corners coincide
        weights[0] = 1.0 - weights[1]
    elif d6 >= 0.0 and d5 <= d6:
        weights[2] = 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        weights[2] = d2 / max(d2 - d6, 1e-300)
        weights[0] = 1.0 - weights[2]
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        weights[2] = (d4 - d3) / max((d4 - d3) + (d5 - d6), 1e-300)
        weights[1] = 1.0 - weights[2]
    else:
        total = va + vb + vc
        weights[0], weights[1], weights[2] = va / total, vb / total, vc / total


@njit(cache=True)
def _query(points, vertices, faces, order, leaves, low, high, bound2):  # type: ignore[no-untyped-def]
    n, dim = points.shape
    m = faces.shape[0]
    best2 = np.full(n, np.inf)
    best_face = np.full(n, -1, dtype=np.int64)
    best_point = np.full((n, dim), np.nan)
    best_weights = np.zeros((n, dim))
    stack, stack_gap = np.empty(128, dtype=np.int64), np.empty(128)
    weights, foot = np.zeros(dim), np.zeros(dim)
    for i in range(n):
        p = points[i]
        limit = bound2
        stack[0], stack_gap[0], top = 0, _box_distance(p, low[0], high[0]), 1
        while top > 0:
            top -= 1
            node = stack[top]
            if stack_gap[top] > limit:
                continue
            if node < leaves - 1:
                near, far = 2 * node + 1, 2 * node + 2
                gap_near, gap_far = _box_distance(p, low[near], high[near]), _box_distance(p, low[far], high[far])
                if gap_far < gap_near:
                    near, far, gap_near, gap_far = far, near, gap_far, gap_near
                stack[top], stack_gap[top] = far, gap_far
                stack[top + 1], stack_gap[top + 1] = near, gap_near
                top += 2
                continue
            leaf = node - (leaves - 1)
            for k in range(leaf * m // leaves, (leaf + 1) * m // leaves):
                f = faces[order[k]]
                if dim == 3:
                    _on_triangle(p, vertices[f[0]], vertices[f[1]], vertices[f[2]], weights)
                else:
                    _on_segment(p, vertices[f[0]], vertices[f[1]], weights)
                gap = 0.0
                for axis in range(dim):
                    foot[axis] = 0.0
                    for corner in range(dim):
                        foot[axis] += weights[corner] * vertices[f[corner], axis]
                    gap += (p[axis] - foot[axis]) ** 2
                if gap <= limit and gap < best2[i]:
                    limit = gap
                    best2[i], best_face[i] = gap, order[k]
                    best_point[i], best_weights[i] = foot, weights
    return best2, best_face, best_point, best_weights
