"""Meshes whose signed distance is known in closed form, and bodies with tubes made from one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from o3dls.arrays import Array
from o3dls.geometry.surface import Surface, outline
from o3dls.levelset.grid.band import Band
from o3dls.levelset.grid.isosurface import zero_set

Distance = Callable[[Array], Array]


def circle(radius: float = 20.0, count: int = 4000) -> Surface:
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return outline(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def round_distance(radius: float = 20.0) -> Distance:
    return lambda points: np.linalg.norm(points, axis=1) - radius


def torus_distance(large: float = 14.0, small: float = 5.0) -> Distance:
    return lambda points: np.hypot(np.hypot(points[:, 0], points[:, 1]) - large, points[:, 2]) - small


def torus(large: float = 14.0, small: float = 5.0, around: int = 96, across: int = 48) -> Surface:
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    u, v = 2.0 * np.pi * i / around, 2.0 * np.pi * j / across
    ring = large + small * np.cos(v)
    vertices = np.column_stack([ring * np.cos(u), ring * np.sin(u), small * np.sin(v)])

    def at(a: Array, b: Array) -> Array:
        return (a % around) * across + b % across

    lower = np.column_stack([at(i, j), at(i + 1, j), at(i + 1, j + 1)])
    upper = np.column_stack([at(i, j), at(i + 1, j + 1), at(i, j + 1)])
    return Surface(vertices, np.vstack([lower, upper]))


def whole_box(distance: Distance, half: float, spacing: float, dimension: int = 3) -> tuple[Band, Array]:
    """A level set on all nodes of the box [-half, half]^d."""
    steps = int(np.ceil(half / spacing))
    shape = (2 * steps + 1,) * dimension
    nodes = np.indices(shape).reshape(dimension, -1).T.astype(np.int32)
    band = Band(spacing, half, np.full(dimension, -steps), shape, np.ascontiguousarray(nodes))
    return band, distance(band.positions)


def meshed(distance: Distance, half: float, spacing: float = 1.0, dimension: int = 3) -> Surface:
    """The surface of a signed distance."""
    return Surface(*zero_set(*whole_box(distance, half, spacing, dimension)))


def ball_with_tube(points: Array, radius: float = 5.0) -> Array:
    """A ball of radius 16 with a round-ended tube about the first axis, whose axis ends at 25."""
    along = np.clip(points[:, 0], 8.0, 25.0)
    tube = np.linalg.norm(points - np.eye(points.shape[1])[0] * along[:, None], axis=1) - radius
    return np.minimum(round_distance(16.0)(points), tube)


def sampled(surface: Surface, count: int, noise: float, seed: int) -> Array:
    """Points evenly over a surface with isotropic noise."""
    rng = np.random.default_rng(seed)
    faces = rng.choice(len(surface.faces), count, p=surface.face_areas / surface.area)
    weights = rng.dirichlet(np.ones(surface.dimension), count)
    points = np.einsum("nc,ncd->nd", weights, surface.vertices[surface.faces[faces]])
    return points + noise * rng.normal(size=points.shape)
