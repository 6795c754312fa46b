"""Bodies, points and motions for the tests of the motion field, in 2D and 3D alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from o3dls.arrays import Array
from o3dls.geometry.similarity import apply, fit_similarity
from o3dls.geometry.surface import Surface, outline
from o3dls.motion.field.covariance import Covariance
from o3dls.motion.field.observations import Data

SIZE = 25.0  # about the rms radius of the bodies, mm


def body(dimension: int, fineness: int = 3) -> Surface:
    """A lopsided closed body without symmetry, about 25 mm in radius."""
    if dimension == 2:
        t = np.linspace(0, 2 * np.pi, 50 * fineness, endpoint=False)
        radius = SIZE * (1 + 0.25 * np.cos(2 * t) + 0.12 * np.sin(3 * t))
        return outline(radius[:, None] * np.column_stack([np.cos(t), np.sin(t)]))
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=fineness)
    x, y, z = ball.vertices.T
    radius = SIZE * (1 + 0.2 * x * y + 0.15 * z**3 + 0.15 * x**2)
    return Surface(ball.vertices * radius[:, None], ball.faces)


def spots(surface: Surface, count: int, seed: int) -> tuple[Array, Array, Array]:
    """Area-uniform points (n, d) of a surface, with faces and barycentric weights to carry them along."""
    rng = np.random.default_rng(seed)
    face = rng.choice(len(surface.faces), count, p=surface.face_areas / surface.area)
    bary = rng.dirichlet(np.ones(surface.dimension), count)
    return np.einsum("nc,ncd->nd", bary, surface.vertices[surface.faces[face]]), face, bary


def wall(points: Array, **changes: object) -> Data:
    """Data of plain wall points, no landmarks."""
    n = len(points)
    none = np.zeros((0, points.shape[1]))
    plain = Data(
        points, np.zeros(n, dtype=np.int64), np.ones(n), np.ones(n), np.zeros(n, dtype=bool), none, none
    )
    return replace(plain, **changes)


def covariance(dimension: int, anchors: int = 0) -> Covariance:
    marks = body(dimension).vertices[np.arange(anchors) * 7]
    return Covariance(
        np.full(dimension, 0.5),
        vector=(1.15 * SIZE,),
        normal=(0.46 * SIZE,),
        radius=SIZE,
        anchors=marks,
        anchor_length=0.38 * SIZE,
        translation=0.2 * SIZE,
        rotation=0.1,
        scale=0.1,
    )


def bend(surface: Surface, seed: int, amplitude: float = 2.0) -> Array:
    """Displacement (n, d) of the vertices from the vector field's prior, without what a pose would do: pulls
    at 60 places, scaled.
    """
    rng = np.random.default_rng(seed)
    at = spots(surface, 60, seed)[0]
    cov = covariance(surface.dimension)
    pull = rng.normal(size=at.shape)
    field = np.zeros_like(surface.vertices)
    for axis in range(surface.dimension):
        r = np.linalg.norm(surface.vertices[:, None] - at[None], axis=2) * 5**0.5 / cov.vector[0]
        field[:, axis] = ((1 + r + r * r / 3) * np.exp(-r)) @ pull[:, axis]
    field = surface.vertices + 1e-3 * field
    field -= apply(fit_similarity(surface.vertices, field), surface.vertices)
    return np.asarray(amplitude * field / np.sqrt((field**2).sum(axis=1).mean()))
