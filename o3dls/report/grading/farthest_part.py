"""The part of a surface without points that is farthest from any."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ...arrays import Array, Ints, Mask
from ...evaluation.interpolation import REACH
from ...geometry.cut_wall import on_cut
from ...geometry.surface import Surface


@dataclass(frozen=True, eq=False)
class FarthestPart:
    """The farthest part is a connected part of the wall: its share of the area, how far its farthest place is
    from every point, and that place (3,).
    """

    share: float
    reach: float
    middle: Array


def farthest_part(surface: Surface, unit: str) -> FarthestPart | None:
    """Return the connected part farther than `REACH` from every point that holds the farthest place of all;
    None where nothing is known of that, as in 2D.
    """
    gap = surface.fields.get(f"distance_to_nearest_point_{unit}")
    if gap is None or surface.dimension == 2:
        return None
    gap = np.where(on_cut(surface), 0.0, gap)  # nobody expects a point there
    most = int(np.argmax(gap))
    area = surface.vertex_areas
    share = float(area[_connect_vertices(surface.faces, gap > REACH, most)].sum() / area.sum())
    return FarthestPart(share, float(gap[most]), surface.vertices[most])


def _connect_vertices(faces: Ints, mask: Mask, start: int) -> Mask:
    """Return the vertices (n,) of a mask that edges within it connect with one of them; none if that one is
    not in it.
    """
    if not mask[start]:
        return np.zeros(len(mask), dtype=bool)
    edges = np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = edges[mask[edges].all(axis=1)]
    graph = sparse.coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(mask), len(mask)))
    label = connected_components(graph, directed=False)[1]
    return np.asarray(mask & (label == label[start]))
