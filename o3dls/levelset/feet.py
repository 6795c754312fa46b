"""Where on the surface each point may have come from: a mean over all walls within reach of its noise, instead of the closest point.

A point p of noise s comes from the surface element x with probability ~ exp(-|p - x|^2 / 2 s^2) dA. The mean over these elements
needs no correction for curvature (on a sphere it gives the s^2 H / 2 by which noise carries points outwards), follows bends of the
wall within the noise, and where two walls compete it halts between them instead of locking to one.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..geometry import Array
from .closest import ClosestPoint, _gap, _nearest
from .covariance import Places
from .rows import Feet
from .shape import vertex_normals

REACH = 3.0  # elements less likely than exp(-3) times the closest are left out: more change no result, and cost time


def likely_feet(tree: ClosestPoint, points: Array, sd: Array, rest: Places) -> Feet:
    """Feet of points (k, d) of noise sd (k,) on the tree's surface, whose vertices in the reference pose are `rest`.

    The normals are means of unit normals: shorter where walls of several directions compete, and so is what the point tells.
    """
    faces = tree.faces[tree.order]
    closest2 = tree.query(points)[0]
    normals = vertex_normals(tree.vertices, tree.faces)
    spatial = np.zeros((len(points), 3))
    spatial[:, : points.shape[1]] = points
    means = _expected(
        spatial, 2.0 * sd**2, closest2, tree.corners, tree.leaves, tree.boxes, faces, normals, rest.at, rest.normals, rest.fairing
    )
    return Feet(*means)


@njit(cache=True)
def _expected(points, width, closest2, corners, leaves, boxes, faces, normals, posed, posed_normals, fairing):  # type: ignore[no-untyped-def]
    """Weighted means over faces, each at its closest point, with weights area * exp(-squared distance / width)."""
    n, m, dim = points.shape[0], faces.shape[0], posed.shape[1]
    at, mean, moved = np.zeros((n, dim)), np.zeros((n, dim)), np.zeros(dim)
    along, fair, residual = np.zeros(n), np.zeros(n), np.zeros(n)
    stack, share = np.empty(128, dtype=np.int64), np.empty(3)
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        limit, total = closest2[i] * (1.0 + 1e-12) + REACH * width[i], 0.0
        moved[:] = 0.0
        stack[0], top = 0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if _gap(x, y, z, boxes, node) > limit:
                continue
            if node < leaves - 1:
                stack[top], stack[top + 1] = 2 * node + 1, 2 * node + 2
                top += 2
                continue
            leaf = node - (leaves - 1)
            for k in range(leaf * m // leaves, (leaf + 1) * m // leaves):
                gap, share[1], share[2] = _nearest(x, y, z, corners, k)
                if gap > limit:
                    continue
                share[0] = 1.0 - share[1] - share[2]
                if dim == 2:  # a segment is a triangle whose last two corners coincide
                    share[1] += share[2]
                weight = _measure(corners, k) * np.exp((closest2[i] - gap) / width[i])
                length = rest_length = height = agreement = bump = 0.0
                for c in range(dim):
                    bump += share[c] * fairing[faces[k, c]]
                for axis in range(dim):
                    normal = rest = offset = 0.0
                    for c in range(dim):
                        normal += share[c] * normals[faces[k, c], axis]
                        rest += share[c] * posed_normals[faces[k, c], axis]
                        offset += share[c] * corners[k, c, axis]
                    length += normal * normal
                    rest_length += rest * rest
                    height += normal * (points[i, axis] - offset)
                    agreement += normal * rest
                length, rest_length = np.sqrt(length) + 1e-300, np.sqrt(rest_length) + 1e-300
                total += weight
                residual[i] += weight * height / length
                agreement /= length * rest_length
                along[i] += weight * agreement
                fair[i] += weight * agreement * bump
                for axis in range(dim):
                    for c in range(dim):
                        part = weight * share[c]
                        mean[i, axis] += part * normals[faces[k, c], axis] / length
                        at[i, axis] += part * posed[faces[k, c], axis]
                        moved[axis] += part * (corners[k, c, axis] - posed[faces[k, c], axis])
        residual[i] /= total
        along[i] /= total
        fair[i] /= total
        for axis in range(dim):
            at[i, axis] /= total
            mean[i, axis] /= total
            residual[i] += mean[i, axis] * moved[axis] / total  # from the foot's place in the reference pose
    return at, mean, along, fair, residual


@njit(cache=True)
def _measure(corners, k):  # type: ignore[no-untyped-def]
    """Twice the area of face k, or, where its last two corners coincide, the length of the segment."""
    ux, uy, uz = corners[k, 1, 0] - corners[k, 0, 0], corners[k, 1, 1] - corners[k, 0, 1], corners[k, 1, 2] - corners[k, 0, 2]
    vx, vy, vz = corners[k, 2, 0] - corners[k, 0, 0], corners[k, 2, 1] - corners[k, 0, 1], corners[k, 2, 2] - corners[k, 0, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    if ux == vx and uy == vy and uz == vz:
        return np.sqrt(ux * ux + uy * uy + uz * uz)
    return np.sqrt(x * x + y * y + z * z)
