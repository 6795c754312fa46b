"""A small chamber that has no symmetry: an ellipsoid with four veins and an appendage, its landmarks, and
points measured on it.
"""

from __future__ import annotations

import numpy as np
from tiny import sphere

from o3dls.arrays import Array
from o3dls.case import Case, Points
from o3dls.geometry.similarity import apply, similarity
from o3dls.geometry.surface import Surface, outline
from o3dls.geometry.twist import rotation

VEINS = {
    "LSPV": (0.80, 0.35, 0.48),
    "LIPV": (0.78, 0.48, -0.38),
    "RSPV": (-0.80, 0.30, 0.50),
    "RIPV": (-0.74, 0.55, -0.36),
}
APPENDAGE = (0.62, -0.66, 0.42)


def chamber(rings: int = 40) -> Surface:
    """About 6 000 triangles, 50 mm across."""
    ball = sphere(1.0, rings)
    directions = ball.vertices
    radius = 18.0 * np.ones(len(directions))
    for axis, height in [*((v, 9.0) for v in VEINS.values()), (APPENDAGE, 14.0)]:
        unit = np.array(axis) / np.linalg.norm(axis)
        radius += height * np.exp(-((1.0 - directions @ unit) / 0.06))
    return ball.with_vertices(directions * radius[:, None] * [1.2, 0.9, 1.05])


def tips(surface: Surface) -> dict[str, Array]:
    """The vertex farthest along each vein."""
    return {
        name: surface.vertices[np.argmax(surface.vertices @ np.array(axis))] for name, axis in VEINS.items()
    }


def sampled(surface: Surface, n: int, seed: int, noise: float = 0.0) -> Array:
    """Points (n, d) uniform on a surface, with normal noise."""
    rng = np.random.default_rng(seed)
    faces = rng.choice(len(surface.faces), n, p=surface.face_areas / surface.face_areas.sum())
    weights = rng.dirichlet(np.ones(surface.dimension), n)
    return np.einsum("nc,ncd->nd", weights, surface.vertices[surface.faces[faces]]) + rng.normal(
        0.0, noise, (n, surface.dimension)
    )


def pose(degrees: float, shift: float, scale: float = 1.0, *, seed: int = 75_913, d: int = 3) -> Array:
    """A similarity of the given size about the origin."""
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=1 if d == 2 else 3)
    way = rng.normal(size=d)
    return similarity(
        rotation(np.radians(degrees) * turn / np.linalg.norm(turn)), shift * way / np.linalg.norm(way), scale
    )


def measured(prior: Surface, truth: Array, n: int = 200, *, noise: float = 0.0, seed: int = 30_817) -> Case:
    """A case whose points and landmarks lie on the prior moved by `truth`."""
    points = apply(truth, sampled(prior, n, seed)) + np.random.default_rng(seed + 1).normal(
        0.0, noise, (n, prior.dimension)
    )
    marks = tips(prior) if prior.dimension == 3 else {}
    xyz = np.vstack([points, *[apply(truth, mark[None]) for mark in marks.values()]])
    kind = np.array(["eam"] * n + ["landmark"] * len(marks))
    return Case("chamber", prior, Points(xyz, kind, {"name": np.array([""] * n + list(marks))}), marks)


def outline_without_symmetry() -> Surface:
    """A closed curve in 2D, 60 across."""
    t = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    r = 30.0 + 6.0 * np.cos(2 * t + 0.4) + 4.0 * np.cos(3 * t + 1.3) + 3.0 * np.sin(5 * t)
    return outline(np.column_stack([r * np.cos(t), r * np.sin(t)]))


def farthest_effect(a: Array, b: Array, surface: Surface) -> float:
    """Longest distance between what two poses do to the vertices of a surface."""
    return float(np.linalg.norm(apply(a, surface.vertices) - apply(b, surface.vertices), axis=1).max())
