"""Small similarity motions about a centre, their tangent space and the way back to a matrix.

A twist lists shift (d), rotation (1 in 2D, 3 in 3D) and log scale (1, where asked for), in this order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .similarity import similarity


@dataclass(frozen=True)
class Twist:
    """A twist has parts whose number and places depend on the dimension `d`."""

    d: int
    scale: bool = False

    @property
    def turn(self) -> slice:
        return slice(self.d, self.d + (1 if self.d == 2 else 3))

    @property
    def size(self) -> int:
        return int(self.turn.stop) + self.scale

    def tangent(self, positions: Array, centre: Array, turned: Array | None = None) -> Array:
        """Return the velocity (n, d, size) of each position (n, d) under the unit motions about `centre`;
        rotations may act at other positions `turned` (n, d).
        """
        arm = positions - centre
        lever = arm if turned is None else turned - centre
        parts = [
            np.broadcast_to(np.eye(self.d), (len(arm), self.d, self.d)),
            np.einsum("gij,nj->nig", turns(self.d), lever),
        ]
        return np.concatenate([*parts, arm[:, :, None]] if self.scale else parts, axis=2)

    def motion(self, twist: Array, centre: Array) -> Array:
        """Return the matrix (d+1, d+1) of the finite motion of a twist (size,) about `centre`."""
        linear = rotation(twist[self.turn]) * (np.exp(twist[-1]) if self.scale else 1.0)
        return similarity(linear, centre + twist[: self.d] - linear @ centre)


def turns(d: int) -> Array:
    """Return the generators (1 or 3, d, d) of the rotations: e_k x."""
    if d == 2:
        return np.array([[[0.0, -1.0], [1.0, 0.0]]])
    generators = np.zeros((3, 3, 3))
    for k in range(3):
        generators[k, (k + 2) % 3, (k + 1) % 3], generators[k, (k + 1) % 3, (k + 2) % 3] = 1.0, -1.0
    return generators


def strains(vertices: Array) -> Array:
    """Return the generators (2 or 5, d, d) of the stretches of a body with these vertices (n, d), about their
    middle, that no similarity imitates.

    Symmetric and without trace, of squared norm 2, then freed of the part that rotation and scale explain at
    the vertices: the similarity nearest to a strained body is the body itself.
    """
    d = vertices.shape[1]
    raw = traceless(d)
    similar = np.concatenate([turns(d), np.eye(d)[None]])
    spread = np.cov(vertices.T)
    gram, shared = (np.einsum("gij,jk,hik->gh", similar, spread, other) for other in (similar, raw))
    return np.asarray(raw - np.einsum("gh,gij->hij", np.linalg.solve(gram, shared), similar))


def traceless(d: int) -> Array:
    """Return orthogonal symmetric matrices (2 or 5, d, d) without trace, of squared norm 2: a strain's size
    is its entry off the diagonal.
    """
    if d == 2:
        return np.array([[[0.0, 1.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, -1.0]]])
    shears = np.zeros((3, 3, 3))
    for k in range(3):
        shears[k, (k + 1) % 3, (k + 2) % 3] = shears[k, (k + 2) % 3, (k + 1) % 3] = 1.0
    return np.concatenate([shears, [np.diag([1.0, -1.0, 0.0]), np.diag([1.0, 1.0, -2.0]) / np.sqrt(3.0)]])


def rotation(vector: Array) -> Array:
    """Return the rotation matrix of an angle (1,) in 2D or a rotation vector (3,) in 3D, radians."""
    cross = np.tensordot(vector, turns(2 if len(vector) == 1 else 3), axes=1)
    angle = float(np.linalg.norm(vector))
    half = np.sinc(angle / (2.0 * np.pi))  # sin(angle/2) / (angle/2), finite at zero
    return np.asarray(np.eye(len(cross)) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * cross @ cross)
