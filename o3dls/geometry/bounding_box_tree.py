"""A tree of bounding boxes over faces, which are split at medians once; the boxes follow moved vertices."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def median_order(centres, leaves):  # type: ignore[no-untyped-def]
    """Order the faces by leaf, so that boxes hardly overlap.

    Each node's centres (d, m) are halved at the median of their longest extent.
    """
    dim, m = centres.shape
    order = np.arange(m)
    stack = np.empty((128, 2), dtype=np.int64)
    stack[0, 0] = 0
    stack[0, 1] = leaves
    top = 1
    while top > 0:
        top -= 1
        first, last = stack[top, 0], stack[top, 1]
        if last - first < 2:
            continue
        half = (first + last) // 2
        low, high, middle = first * m // leaves, last * m // leaves, half * m // leaves
        longest, axis = -1.0, 0
        for k in range(dim):
            least, most = np.inf, -np.inf
            for i in range(low, high):
                least, most = min(least, centres[k, order[i]]), max(most, centres[k, order[i]])
            if most - least > longest:
                longest = most - least
                axis = k
        _partition_order(centres[axis], order, low, high - 1, middle)
        stack[top, 0], stack[top, 1] = first, half
        stack[top + 1, 0], stack[top + 1, 1] = half, last
        top += 2
    return order


@njit(cache=True, nogil=True)
def _partition_order(values, order, left, right, middle):  # type: ignore[no-untyped-def]
    """Rearrange order[left : right + 1] so that no value before `middle` exceeds one behind it.

    Hoare's selection.
    """
    while left < right:
        pivot = values[order[(left + right) // 2]]
        i, j = left, right
        while i <= j:
            while values[order[i]] < pivot:
                i += 1
            while values[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@njit(cache=True, nogil=True)
def corners_and_boxes(axes, vertices, faces, leaves):  # type: ignore[no-untyped-def]
    """Return the corners (m, 3, 3) of faces in tree order, and bounding boxes (low, high) of an implicit
    binary tree.

    Children of node i are 2i+1 and 2i+2, the leaves come last.
    """
    m, dim = len(faces), len(axes)
    corners = np.zeros((m, 3, 3))
    boxes = np.empty((2 * leaves - 1, 2, 3))
    for leaf in range(leaves):
        x0 = y0 = z0 = np.inf  # scalars stay in registers
        x1 = y1 = z1 = -np.inf
        for k in range(leaf * m // leaves, (leaf + 1) * m // leaves):
            for corner in range(3):
                for axis in range(dim):
                    corners[k, corner, axis] = vertices[faces[k, min(corner, dim - 1)], axis]
                x, y, z = corners[k, corner, 0], corners[k, corner, 1], corners[k, corner, 2]
                x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
                x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
        box = boxes[leaves - 1 + leaf]
        box[0, 0], box[0, 1], box[0, 2] = x0, y0, z0
        box[1, 0], box[1, 1], box[1, 2] = x1, y1, z1
    for node in range(leaves - 2, -1, -1):
        for axis in range(3):
            boxes[node, 0, axis] = min(boxes[2 * node + 1, 0, axis], boxes[2 * node + 2, 0, axis])
            boxes[node, 1, axis] = max(boxes[2 * node + 1, 1, axis], boxes[2 * node + 2, 1, axis])
    return corners, boxes


@njit(cache=True, nogil=True)
def box_gap(x, y, z, boxes, node):  # type: ignore[no-untyped-def]
    """Return the squared distance of a point from a box."""
    dx = max(boxes[node, 0, 0] - x, x - boxes[node, 1, 0], 0.0)
    dy = max(boxes[node, 0, 1] - y, y - boxes[node, 1, 1], 0.0)
    dz = max(boxes[node, 0, 2] - z, z - boxes[node, 1, 2], 0.0)
    return dx * dx + dy * dy + dz * dz
