"""Priors as segmentation goes wrong: leaked into what lies beside the atrium, or cut short on thick
voxels.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from o3dls import Surface

from . import motion as moves
from . import shapes, wall
from .meshing import mesh
from .shapes import Array, Shape

Leak = Literal["ventricle", "aorta"]
SPACING = 1.5  # mm, of the surface of what leaked
MARGIN = 4.0  # mm around what is meshed
OPEN_WIDTH = 0.8  # cosine: what lies so near to a direction tells how far the wall reaches that way
BALL = (15.0, 21.0)  # mm, radius of a ventricle
TUBE = (8.0, 10.5)  # mm, radius of an aorta
LENGTH = (70.0, 100.0)  # mm
OVERLAP = (2.0, 5.0)  # mm by which what leaked lies within the atrium: the leak's mouth
BLEND = 3.0  # mm, of the groove about the mouth
VOXEL = (1.25, 1.25, 2.5)  # mm
SHORT = (10.0, 15.0)  # mm that an end lost
END = 22.0  # mm: an end is what lies within this of its tip


def leaked(rng: np.random.Generator, prior: Surface, into: Leak) -> Surface:
    """The atrium and, in one piece with it, a ball as large as a ventricle, or a long tube as an aorta, that
    overlaps it by 2 to 5 mm on a side where no vein is.
    """
    way, reach = free_side(rng, prior)
    touching = wall.body(prior)[0] + reach * way
    other, ends = _ventricle(rng) if into == "ventricle" else _aorta(rng, way)
    at = _against(prior, other, touching, way, rng.uniform(*OVERLAP))
    corners = np.vstack([prior.vertices, at + ends])
    low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
    both = shapes.union(solid(prior), shapes.move(other, at), blend=BLEND)
    return wall.mended(wall.largest(mesh(both, low, high, SPACING)))


def _ventricle(rng: np.random.Generator) -> tuple[Shape, Array]:
    """A ball about the origin, and corners (k, 3) of its box."""
    radius = rng.uniform(*BALL)
    return shapes.ball(np.zeros(3), radius), radius * np.array([[-1.0] * 3, [1.0] * 3])


def _aorta(rng: np.random.Generator, way: Array) -> tuple[Shape, Array]:
    """A tube across a direction, its middle in the origin, and corners of its ends' boxes."""
    radius = rng.uniform(*TUBE)
    axis = np.cross(way, moves.direction(rng))
    half = 0.5 * rng.uniform(*LENGTH) * axis / np.linalg.norm(axis)
    ends = np.array([-half, half])
    return shapes.round_cone(-half, half, radius, radius + 0.01), np.vstack([ends - radius, ends + radius])


def _against(prior: Surface, other: Shape, start: Array, way: Array, overlap: float) -> Array:
    """Where a shape has to stand along a direction, so that the wall lies within it by `overlap` (mm): the
    side has hollows, and beside one a tube would touch nothing.
    """
    at = start + 2.0 * BALL[1] * way
    for _ in range(60):
        deep = float(other(prior.vertices - at).min())
        at = at - max(deep + overlap, 0.0) * way
    return at


def coarse(rng: np.random.Generator, prior: Surface) -> Surface:
    """The atrium as labelled by hand on voxels of 1.25 x 1.25 x 2.5 mm, without the last 10 to 15 mm of two
    of its ends (a vein, an appendage).
    """
    centre = wall.body(prior)[0]
    ends = prior.vertices[wall.far_places(prior, 6)[rng.choice(6, 2, replace=False)]]
    shape = solid(prior)
    for end, short in zip(ends, rng.uniform(*SHORT, 2), strict=True):
        way = (end - centre) / np.linalg.norm(end - centre)
        tip = shapes.intersection(shapes.ball(end, END), _beyond(way, float(way @ end) - short))
        shape = _without(shape, tip)
    return wall.mended(wall.largest(_voxels(shape, prior)))


def solid(surface: Surface) -> Shape:
    """A closed surface as a shape."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(surface.vertices.astype(np.float32), surface.faces.astype(np.uint32))

    def distance(points: Array) -> Array:
        at = o3d.core.Tensor(np.ascontiguousarray(points, dtype=np.float32))
        return np.asarray(scene.compute_signed_distance(at, nthreads=1, nsamples=3).numpy(), dtype=float)

    return distance


def free_side(rng: np.random.Generator, surface: Surface) -> tuple[Array, float]:
    """A direction (3,) from the centre in which no vein goes, and how far the wall reaches that way."""
    arms = surface.vertices - wall.body(surface)[0]
    length = np.linalg.norm(arms, axis=1)
    ways = np.array([moves.direction(rng) for _ in range(60)])
    near = arms @ ways.T > OPEN_WIDTH * length[:, None]
    reach = np.where(near, arms @ ways.T, 0.0).max(axis=0)
    chosen = rng.choice(np.argsort(reach)[:12])
    return ways[chosen], float(reach[chosen])


def _beyond(way: Array, offset: float) -> Shape:
    return shapes.half_space(-way, -offset)


def _without(shape: Shape, other: Shape) -> Shape:
    return lambda p: np.maximum(shape(p), -other(p))


def _voxels(shape: Shape, about: Surface) -> Surface:
    """The surface between voxels whose centres are inside and those whose are not, with a little of the
    stairs smoothed away as viewers do.
    """
    import open3d as o3d
    from scipy.ndimage import gaussian_filter

    size = np.array(VOXEL)
    low, high = about.vertices.min(axis=0) - 2.0 * size, about.vertices.max(axis=0) + 3.0 * size
    axes = [np.arange(a, b, step) for a, b, step in zip(low, high, size, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = (shape(grid.reshape(-1, 3)) < 0.0).reshape(grid.shape[:3]).astype(np.float32)
    values = 0.5 - gaussian_filter(inside, 0.6)
    raw = o3d.t.geometry.TriangleMesh.create_isosurfaces(
        o3d.core.Tensor(np.ascontiguousarray(values.T)), [0.0]
    )
    vertices = raw.vertex.positions.numpy().astype(np.float64) * size + low
    return Surface(vertices, raw.triangle.indices.numpy()[:, ::-1].astype(np.int64))
