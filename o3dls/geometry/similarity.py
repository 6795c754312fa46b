"""Similarities as homogeneous matrices: applied, told from others, fitted to pairs of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array

POSE_ROUNDING = 0.01  # of a rotation's entries, which files give with as few as two digits


TURN = np.diag([-1.0, -1.0, 1.0, 1.0])  # LPS to RAS and back


def apply(matrix: Array, points: ArrayLike) -> Array:
    """Return the points (n, d) under a homogeneous (d+1, d+1) matrix."""
    points = np.asarray(points, dtype=np.float64)
    return np.asarray(points @ matrix[:-1, :-1].T + matrix[:-1, -1])


def inverse(matrix: Array) -> Array:
    """Return the matrix that leads back."""
    return np.asarray(np.linalg.inv(matrix))


def rms_radius(vertices: Array) -> float:
    """Return the root mean square distance of vertices (n, d) from their middle: the lever that turns angles
    into lengths.
    """
    return float(np.sqrt(vertices.var(axis=0).sum()))


def similarity(rotation: Array, translation: Array, scale: float = 1.0) -> Array:
    """Return the homogeneous matrix of x -> scale * rotation @ x + translation."""
    matrix = np.eye(len(translation) + 1)
    matrix[:-1, :-1] = scale * rotation
    matrix[:-1, -1] = translation
    return matrix


def principal_frame(points: Array) -> Array:
    """Return the rigid matrix (d+1, d+1), mirroring or not, into the centre and principal axes of points (n,
    d), each turned to the longer tail: what is numbered by cells there does not depend on the frame that the
    points are given in.
    """
    x = points - points.mean(axis=0)
    axes = np.linalg.eigh(x.T @ x)[1]
    along = x @ axes
    # a product, since a power takes ten times as long
    axes = axes * np.where((along * along * along).sum(axis=0) < 0.0, -1.0, 1.0)
    return similarity(axes.T, -points.mean(axis=0) @ axes)


def scale_of(matrix: Array) -> float:
    """Return the scale factor of a similarity: the d-th root of its determinant."""
    return float(abs(np.linalg.det(matrix[:-1, :-1])) ** (1.0 / (len(matrix) - 1)))


def is_pose(matrix: Array, dimension: int) -> bool:
    """Return whether a matrix is a rotation with scale and shift, written out (d+1, d+1); rounded to some
    digits it still is.
    """
    if matrix.shape != (dimension + 1, dimension + 1) or not np.isfinite(matrix).all():
        return False
    linear = matrix[:-1, :-1]
    with np.errstate(over="ignore", invalid="ignore"):  # overflow needs numbers that no pose has
        if not np.linalg.det(linear) > 0.0 or not np.allclose(matrix[-1], np.eye(dimension + 1)[-1]):
            return False
        turn = linear / scale_of(matrix)
        return bool(np.allclose(turn @ turn.T, np.eye(dimension), atol=POSE_ROUNDING))


def fit_similarity(
    source: Array, target: Array, weights: Array | None = None, *, scale: bool = True
) -> Array:
    """Return the least-squares similarity (or rigid motion) that maps source (..., n, d) onto target (n, d)
    (Umeyama 1991): one for each source.
    """
    w = np.ones(len(target)) if weights is None else np.asarray(weights, dtype=np.float64)
    w = w / w.sum()
    mean_a, mean_b = w @ source, w @ target
    a, b = source - mean_a[..., None, :], target - mean_b
    u, s, vt = np.linalg.svd((b * w[:, None]).T @ a)
    sign = np.ones_like(s)
    sign[..., -1] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * sign[..., None, :]) @ vt
    factor = (s * sign).sum(axis=-1) / ((a**2).sum(axis=-1) @ w) if scale else np.ones(s.shape[:-1])
    matrix = np.zeros((*s.shape[:-1], s.shape[-1] + 1, s.shape[-1] + 1))
    matrix[..., :-1, :-1] = factor[..., None, None] * rotation
    matrix[..., :-1, -1] = mean_b - (matrix[..., :-1, :-1] @ mean_a[..., None])[..., 0]
    matrix[..., -1, -1] = 1.0
    return matrix
