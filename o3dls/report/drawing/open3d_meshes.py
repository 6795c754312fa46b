"""Surfaces as Open3D draws them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...arrays import Array
from ...geometry.surface import Surface
from ..surfaces.display import decimated

EDGE_FACES = 4000  # a surface drawn as edges has at most so many: more would hide what is behind


def mesh(surface: Surface, colours: Array, *, lit: bool = True) -> Any:
    """Make a triangle mesh with a colour (n, 3) of each vertex; one that is not lit has these colours from
    wherever it is seen.
    """
    import open3d as o3d

    made = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(surface.vertices),
        o3d.utility.Vector3iVector(surface.faces.astype(np.int32)),
    )
    made.vertex_colors = o3d.utility.Vector3dVector(colours)
    if lit:
        made.compute_vertex_normals()  # without normals Open3D puts no light on it
    return made


def plain(surface: Surface, colour: str) -> Any:
    """Make a triangle mesh in one CSS colour `#rrggbb`, without light."""
    return mesh(surface, np.tile(rgb(colour), (len(surface.vertices), 1)), lit=False)


def balls(centres: Array, colours: Array) -> Any:
    """Make balls of 1 mm about centres (n, 3) in colours (n, 3), as one mesh."""
    import open3d as o3d

    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 8)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.triangles)
    every = (centres[:, None] + vertices[None]).reshape(-1, 3)
    index = (faces[None] + len(vertices) * np.arange(len(centres))[:, None, None]).reshape(-1, 3)
    return mesh(Surface(every, index), np.repeat(colours, len(vertices), axis=0))


def edges(surface: Surface, colour: str) -> Any:
    """Return the edges of a surface, made coarse, in one CSS colour."""
    import open3d as o3d

    coarse = decimated(replace(surface, fields={}), EDGE_FACES, EDGE_FACES)
    lines = o3d.geometry.LineSet.create_from_triangle_mesh(plain(coarse, colour))
    lines.paint_uniform_color(rgb(colour))
    return lines


def rgb(colour: str) -> Array:
    """Return red, green and blue (3,) in [0, 1] of a CSS colour `#rrggbb`."""
    return np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
