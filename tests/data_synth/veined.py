"""A chamber with four long veins, quick to mesh, in place of a real one."""

from __future__ import annotations

import numpy as np

from data_synth import shapes
from data_synth.meshing import mesh
from o3dls import Surface

CHAMBER = 20.0  # mm, the radius
WIDTH = 6.0  # and that of its veins
DIRECTIONS = np.array([(1.0, 0.4, 0.2), (-1.0, 0.3, 0.2), (0.8, -0.3, 0.7), (-0.7, -0.4, 0.8)])


def veined(length: float, spacing: float = 2.0) -> Surface:
    """The chamber with veins that end `length` mm beyond it."""
    ways = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None]
    end = CHAMBER + length - WIDTH
    veins = (shapes.chain([(0.0, 0.0, 0.0), tuple(end * way)], [WIDTH + 0.5, WIDTH]) for way in ways)
    shape = shapes.union(shapes.ball((0.0, 0.0, 0.0), CHAMBER), *veins, blend=2.0)
    size = CHAMBER + length + 6.0
    return mesh(shape, (-size,) * 3, (size,) * 3, spacing)
