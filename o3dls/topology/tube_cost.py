"""What a tube costs: by the points that it explains, and by how common it is."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..arrays import TINY, Array
from ..geometry.closest_point import STACK, FaceTree, nearest_face
from ..noise.likelihood import losses
from .settings import TubeSettings
from .wall import Wall


@njit(cache=True, nogil=True)
def cone(points, tube):  # type: ignore[no-untyped-def]
    """Return nearly the signed distance (n,) of points (n, d) from a round-ended cone [start (d), end (d),
    log radii (2)].
    """
    n, d = points.shape
    radius, other = np.exp(tube[2 * d]), np.exp(tube[2 * d + 1])
    length2 = 0.0
    for a in range(d):
        length2 += (tube[d + a] - tube[a]) ** 2
    off = np.empty(n)
    for i in range(n):
        along = 0.0
        for a in range(d):
            along += (points[i, a] - tube[a]) * (tube[d + a] - tube[a])
        along = min(max(along / max(length2, TINY), 0.0), 1.0)
        gap2 = 0.0
        for a in range(d):
            gap2 += (points[i, a] - tube[a] - along * (tube[d + a] - tube[a])) ** 2
        off[i] = np.sqrt(gap2) - radius - (other - radius) * along
    return off


@njit(cache=True, nogil=True)
def losses_with(points, tube, distance, bias, sigma, one_sided, fraction, outside, inside):  # type: ignore[no-untyped-def]
    """Return -log p (n,) of points at a distance (n,) from a surface once it is united with a tube."""
    united = np.minimum(distance, cone(points, tube)) - bias
    return losses(united, sigma, one_sided, fraction, outside, inside)


class Foot:
    """This gives how high one place after another lies over a wall: each as a rule near the last."""

    def __init__(self, wall: Wall) -> None:
        tree = wall.tree
        self.surface = wall.normals[tree.in_order], tree.corners, tree.leaves, tree.boxes
        self.face = -1

    def height(self, place: Array) -> float:
        height, self.face = _height_over_wall(place, self.face, *self.surface)
        return float(height)


@njit(cache=True, nogil=True)
def _height_over_wall(place, guess, normals, corners, leaves, boxes):  # type: ignore[no-untyped-def]
    """Return the signed distance of a place (d,) from a wall with normals (m, d, d) at the corners of its
    faces, and the face of its foot, sought from a guess.
    """
    at = np.zeros(3)
    at[: len(place)] = place
    waiting = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    tree = FaceTree(corners, leaves, boxes)
    face, squared, v, w = nearest_face((at[0], at[1], at[2]), guess, np.inf, tree, waiting)
    along = 0.0
    weights = (1.0 - v - w, v, w)
    for a in range(len(place)):
        foot, outward = 0.0, 0.0
        for c in range(3):
            foot += weights[c] * corners[face, c, a]
        for c in range(len(place)):
            outward += weights[c] * normals[face, c, a]
        along += (place[a] - foot) * outward
    return (-np.sqrt(squared) if along < 0.0 else np.sqrt(squared)), face


def rarity(foot: Foot, tube: Array, radius: float, settings: TubeSettings) -> float:
    """Return -log of how common a tube is: of usual radius, even, no longer than need be, and rooted in the
    body.
    """
    s = settings
    shape = s.radius * radius, s.radius_log_sd, s.taper_log_sd
    return float(_price_oddity(tube, radius, *shape, foot.height(tube[: len(tube) // 2 - 1]), s.rooted))


@njit(cache=True, nogil=True)
def _price_oddity(tube, radius, usual, log_sd, taper_log_sd, height, rooted):  # type: ignore[no-untyped-def]
    d = len(tube) // 2 - 1
    start, end = tube[2 * d], tube[2 * d + 1]
    length2, sizes2 = 0.0, 0.0
    for a in range(d):
        length2 += (tube[d + a] - tube[a]) ** 2
    for size in (start, end):
        sizes2 += ((size - np.log(usual)) / log_sd) ** 2
    taper = (end - start) / taper_log_sd
    bare = max(height / np.exp(start) + rooted, 0.0)
    return 0.5 * sizes2 + 0.5 * taper**2 + 2.0 * bare**2 + np.sqrt(length2) / radius
