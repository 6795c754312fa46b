"""The pose of points on a surface when nothing is known: many starts slide down a coarse lattice, the best
are refined.

Points are moved into the prior frame (x = scale * rotation @ point + shift), because there the lattice stands
still.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Array
from ..geometry.similarity import similarity
from .lattice import Lattice, sample

THINNED = 80  # points of the first round, spread evenly
SURVIVORS = 40  # poses of the second round, which sees all points
ROUNDS = (12, 15)  # steps of the two rounds
WIDTHS = (0.55, 0.15)  # width of the Geman-McClure kernel, from first to last, in rms radii of the surface
CANDIDATES = 5  # poses that leave the search
SCALE_SD = 0.1
APART = np.radians(20.0)  # poses that differ less are one


class _Moving(NamedTuple):
    """Moving poses have rotations (k, 3, 3), shifts (k, 3) and scales (k,), which change in place."""

    rotations: Array
    shifts: Array
    scales: Array


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses are rotations (k, 3, 3), shifts (k, 3) and scales (k,) of points about `middle` (d,) into the
    prior frame, with mean robust costs (k,) in [0, 1]; in 2D the third axis stays where it is.
    """

    rotations: Array
    shifts: Array
    scales: Array
    costs: Array
    middle: Array

    def T_map_prior(self, row: int, *, scale: bool) -> Array:
        """Return one pose as a matrix (d+1, d+1) from prior to map, with its scale or without."""
        d = len(self.middle)
        linear = self.rotations[row, :d, :d].T / (self.scales[row] if scale else 1.0)
        return similarity(linear, self.middle - linear @ self.shifts[row, :d])

    def distinct(self, apart: float, count: int) -> Poses:
        """Return the cheapest, cheapest first, whose rotations differ by more than `apart` radians, at most
        `count`.
        """
        rows: list[int] = []
        for i in np.argsort(self.costs, kind="stable"):
            cosines = (np.einsum("kij,ij->k", self.rotations[rows], self.rotations[i]) - 1.0) / 2.0
            if len(rows) < count and (cosines < np.cos(apart)).all():
                rows.append(int(i))
        return Poses(
            self.rotations[rows], self.shifts[rows], self.scales[rows], self.costs[rows], self.middle
        )


def search(points: Array, lattice: Lattice, centre: Array, radius: float, starts: int) -> Poses:
    """Return the poses of points (n, d) near the surface of this centre (d,) and rms radius, cheapest first,
    no two alike.
    """
    d = points.shape[1]
    few = thinned(points, THINNED)
    middle = few.mean(axis=0)
    spatial = np.zeros((len(points), 3))
    target = np.zeros(3)
    spatial[:, :d] = points - middle
    target[:d] = centre
    rotations = even_rotations(starts, d)
    widths = np.array(WIDTHS) * radius
    begin = Poses(rotations, np.tile(target, (starts, 1)), np.ones(starts), np.zeros(starts), middle)
    top = _slide_poses(thinned(spatial, THINNED), begin, lattice, widths, ROUNDS[0]).distinct(
        0.5 * APART, SURVIVORS
    )
    return _slide_poses(spatial, top, lattice, widths[[1, 1]], ROUNDS[1]).distinct(APART, CANDIDATES)


def even_rotations(count: int, d: int) -> Array:
    """Return the rotation matrices (count, 3, 3) spread evenly: all of them in 3D (super-Fibonacci spirals,
    Alexa 2022), about z in 2D.
    """
    steps = np.arange(count) + 0.5
    if d == 2:
        w, z = np.cos(np.pi * steps / count), np.sin(np.pi * steps / count)
        x = y = np.zeros(count)
    else:
        r = np.sqrt(steps / count)
        s = np.sqrt(1.0 - steps / count)
        a = 2.0 * np.pi * steps / np.sqrt(2.0)
        b = 2.0 * np.pi * steps / 1.533751168755204288118041
        x, y, z, w = r * np.sin(a), r * np.cos(a), s * np.sin(b), s * np.cos(b)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(rows), 2, 0))


def thinned(points: Array, count: int) -> Array:
    """Return at most `count` points, each as far as can be from those before it: clusters lose their
    weight.
    """
    chosen = [int(np.argmin(((points - np.median(points, axis=0)) ** 2).sum(axis=1)))]
    nearest = ((points - points[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
    return points[chosen]


def _slide_poses(points: Array, begin: Poses, lattice: Lattice, widths: Array, steps: int) -> Poses:
    """Return the poses after `steps` steps under a kernel that narrows from widths[0] to widths[1]."""
    moved = _Moving(begin.rotations.copy(), begin.shifts.copy(), begin.scales.copy())
    costs = _descend_from_starts(np.ascontiguousarray(points), moved, lattice, widths, steps)
    return Poses(*moved, costs, begin.middle)


@njit(cache=True)
def _descend_from_starts(points, poses, lattice, widths, steps):  # type: ignore[no-untyped-def]
    """Descend by Gauss-Newton with Geman-McClure weights from every start: change the poses in place, return
    their costs at the last of the two widths.
    """
    rotations, shifts, scales = poses
    wide, narrow = widths
    costs = np.empty(len(scales))
    for k in range(len(scales)):
        rotation, shift, scale = rotations[k], shifts[k], scales[k]
        for step in range(steps + 1):
            width = narrow if step >= steps - 3 else wide * (narrow / wide) ** (step / max(1, steps - 3))
            cost, hessian, gradient = _normal_equations(points, scale * rotation, shift, lattice, width)
            if step == steps:
                break
            precision = (0.5 * narrow / SCALE_SD) ** 2
            hessian[6, 6] += precision
            gradient[6] -= precision * np.log(scale)
            for a in range(7):
                hessian[a, a] += 1e-3 * hessian[a, a] + 1e-9
            twist = np.linalg.solve(hessian, gradient)
            angle = np.sqrt((twist[3:6] ** 2).sum())
            if angle > 0.35:  # larger turns leave the tangent planes' range
                twist = twist * (0.35 / angle)
                angle = 0.35
            rotation[:] = _turn_rotation(twist[3:6], angle, rotation)
            scale = min(max(scale * np.exp(twist[6]), 0.7), 1.4)
            shift += twist[:3]
        scales[k], costs[k] = scale, cost
    return costs


@njit(cache=True)
def _normal_equations(points, linear, shift, lattice, width):  # type: ignore[no-untyped-def]
    """Return the mean cost, its Hessian and its descent gradient over (shift, rotation about the points'
    origin, log scale).
    """
    hessian, gradient, row = np.zeros((7, 7)), np.zeros(7), np.empty(7)
    cost = 0.0
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        x = linear[0, 0] * px + linear[0, 1] * py + linear[0, 2] * pz
        y = linear[1, 0] * px + linear[1, 1] * py + linear[1, 2] * pz
        z = linear[2, 0] * px + linear[2, 1] * py + linear[2, 2] * pz
        value, gx, gy, gz = sample(lattice, x + shift[0], y + shift[1], z + shift[2])
        ratio = (value / width) ** 2
        weight = 1.0 / (1.0 + ratio) ** 2
        cost += ratio / (1.0 + ratio)
        row[0], row[1], row[2] = gx, gy, gz
        row[3], row[4], row[5] = y * gz - z * gy, z * gx - x * gz, x * gy - y * gx
        # distances shrink with the points: judged in the map, not in the prior frame
        row[6] = x * gx + y * gy + z * gz - value
        for a in range(7):
            gradient[a] -= weight * row[a] * value
            for b in range(a + 1):
                hessian[a, b] += weight * row[a] * row[b]
    for a in range(7):
        for b in range(a):
            hessian[b, a] = hessian[a, b]
    return cost / len(points), hessian, gradient


@njit(cache=True)
def _turn_rotation(vector, angle, rotation):  # type: ignore[no-untyped-def]
    """Turn a rotation (3, 3) further by a rotation vector of this angle (Rodrigues)."""
    if angle < 1e-12:
        return rotation.copy()
    x, y, z = vector / angle
    c, s = np.cos(angle), np.sin(angle)
    d = 1.0 - c
    turn = np.array(
        [
            [c + x * x * d, x * y * d - z * s, x * z * d + y * s],
            [y * x * d + z * s, c + y * y * d, y * z * d - x * s],
            [z * x * d - y * s, z * y * d + x * s, c + z * z * d],
        ]
    )
    return turn @ rotation
