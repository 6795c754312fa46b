"""Small similarity motions about a centre: their tangent space, and the way back to a matrix."""

from __future__ import annotations

import numpy as np

from ..geometry import Array, similarity


def tangent(positions: Array, centre: Array, *, scale: bool) -> Array:
    """Velocity (n, d, k) of each position (n, d) under the k unit motions: d shifts, the rotations about `centre`, log scale."""
    arm = positions - centre
    n, d = arm.shape
    shifts = np.broadcast_to(np.eye(d), (n, d, d))
    turns = _turn(arm)
    return np.concatenate([shifts, turns, arm[:, :, None]] if scale else [shifts, turns], axis=2)


def _turn(arm: Array) -> Array:
    """Velocity (n, d, r) under unit rotation: one axis in 2D, three in 3D (e_j x arm)."""
    if arm.shape[1] == 2:
        return np.stack([-arm[:, 1], arm[:, 0]], axis=1)[:, :, None]
    x, y, z = arm.T
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], axis=1), np.stack([z, o, -x], axis=1), np.stack([-y, x, o], axis=1)], axis=2)


def motion(twist: Array, centre: Array) -> Array:
    """Matrix (d+1, d+1) of the finite motion of a twist (shift, rotation vector, optional log scale) about `centre`."""
    d = len(centre)
    turns = 1 if d == 2 else 3
    factor = float(np.exp(twist[d + turns])) if len(twist) > d + turns else 1.0
    linear = factor * rotation(twist[d : d + turns])
    return similarity(linear, centre + twist[:d] - linear @ centre)


def rotation(vector: Array) -> Array:
    """Rotation matrix of an angle (1,) in 2D or a rotation vector (3,) in 3D, radians."""
    angle = float(np.linalg.norm(vector))
    if len(vector) == 1:
        c, s = np.cos(vector[0]), np.sin(vector[0])
        return np.array([[c, -s], [s, c]])
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    half = np.sinc(angle / (2.0 * np.pi))  # sin(angle/2) / (angle/2), finite at zero
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * cross @ cross)
