"""The parts of an atrium: its body, and the tubes that leave it, which are veins and the appendage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from o3dls import Surface

from . import wall
from .sampling import Mask, Rows
from .shapes import Array
from .solid import deepest, meshed, sampled, solid

OPENED = 0.55  # of the largest ball inside: balls of this size make the body; veins are narrower
SPACING = 2.0  # mm of the grid by which the body is found
ROOT = 2.0  # mm: the body's corners and folds are rounded off by less
LEAST = 7.0  # mm: what ends nearer to the body is no tube
STEP = 1.0  # mm, from one depth to the next at which tubes are told apart
PROMINENT = 4.0  # mm, by which two ends of one tube stand out beyond their common trunk
TRUNK = 10.0  # mm: tubes that part deeper than this are branches of one


@dataclass(frozen=True, eq=False)
class Chamber:
    """How deep (n,) each vertex of a surface lies in a tube, mm from the body (0 on it), and the number (n,)
    of its tube, the longest being 0; -1 on the body.
    """

    depth: Array
    tube: Rows

    @property
    def tubes(self) -> int:
        return int(self.tube.max()) + 1


def chamber(surface: Surface, trunk: float = TRUNK) -> Chamber:
    """The parts of a closed surface. The body is its opening: all that balls cover that fit inside and have
    0.55 times the radius of the largest that does. Tubes that part within `trunk` mm of the body are told
    apart, and what they have in common goes to the nearest.
    """
    depth = _beyond_body(surface)
    ends = [
        end for root in _pieces(surface, depth, ROOT, LEAST) for end in _ends(surface, depth, root, trunk)
    ]
    ends.sort(key=lambda end: -float(depth[end].max()))
    return Chamber(depth, _nearest_end(surface, depth, ends))


def _beyond_body(surface: Surface) -> Array:
    """Distance (n,) of vertices from the body, 0 on it."""
    inside = sampled(solid(surface), surface.vertices, SPACING)
    ball = OPENED * -deepest(inside, surface.vertices)
    centres = meshed(lambda p: inside(p) + ball, surface.vertices, SPACING)
    gap = cKDTree(centres.vertices).query(surface.vertices)[0]
    return np.asarray(np.maximum(gap - ball, 0.0))


def _pieces(
    surface: Surface, depth: Array, beyond: float, reach: float, of: Mask | None = None
) -> list[Mask]:
    """Vertices (n,) beyond a depth, by what hangs together and reaches another depth."""
    deep = depth > beyond if of is None else of & (depth > beyond)
    rows = np.flatnonzero(deep)
    _, number = connected_components(wall.edges(surface)[rows][:, rows])
    pieces = [rows[number == k] for k in range(number.max(initial=-1) + 1)]
    return [_mask(len(deep), piece) for piece in pieces if depth[piece].max() >= reach]


def _ends(surface: Surface, depth: Array, tube: Mask, trunk: float) -> list[Mask]:
    """The tube, or where it forks within `trunk` mm of the body its branches."""
    level = float(depth[tube].min())
    while level < min(trunk, float(depth[tube].max()) - PROMINENT):
        level += STEP
        branches = _pieces(surface, depth, level, level + PROMINENT, tube)
        if len(branches) > 1:
            return [end for branch in branches for end in _ends(surface, depth, branch, trunk)]
    return [tube]


def _nearest_end(surface: Surface, depth: Array, ends: list[Mask]) -> Rows:
    """Number (n,) of the tube of each vertex, -1 on the body and on bumps."""
    tube = np.full(len(depth), -1, dtype=np.int64)
    rows = np.flatnonzero(depth > ROOT)
    links = wall.edges(surface)[rows][:, rows]
    ways = [dijkstra(links, indices=np.flatnonzero(end[rows]), min_only=True) for end in ends]
    if ways:
        away = np.array(ways)
        tube[rows] = np.where(np.isfinite(away.min(axis=0)), away.argmin(axis=0), -1)
    return tube


def _mask(n: int, rows: Rows) -> NDArray[np.bool_]:
    found = np.zeros(n, dtype=bool)
    found[rows] = True
    return found
