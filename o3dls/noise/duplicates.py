"""Places: mapping points that lie closer together than noise would leave them are one place, and count
once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..arrays import Array, Ints
from .settings import DuplicateSettings

DEFAULTS = DuplicateSettings()


def duplicate_distance(
    xyz: Array, kind: NDArray[np.str_], size: float, settings: DuplicateSettings = DEFAULTS
) -> float:
    """Return the distance within which points are of one place: the largest within which there are more pairs
    than chance makes; 0 without any.

    Noise scatters points in all directions, so that neighbours at random are rarer than the ring around them
    has it: by the square of the radius over an area, by the radius itself along contours and a dragged
    catheter, and the ring's own growth tells which. Copies, beats of one contact and merged maps are not, and
    their noise is the same: counted one by one they would make it look small, and all else certain. xyz (n,
    d), kind (n,): the type of each point; size: rms radius of the prior.
    """
    wall = kind != "inside"
    at = _by_type(xyz[wall], kind[wall], settings.ring * settings.distances[0] * size)
    tree = cKDTree(np.unique(at, axis=0))
    radii = size * np.outer([1.0, settings.ring**0.5, settings.ring], settings.distances)
    pairs = np.empty(radii.size)
    order = np.argsort(radii.ravel())
    # pairs within every radius, counted in one pass
    pairs[order] = (tree.count_neighbors(tree, radii.ravel()[order]) - tree.n) / 2.0
    near, middle, wide = pairs.reshape(radii.shape)
    line, area = settings.ring**0.5, settings.ring ** (0.5 * (xyz.shape[1] - 1))
    weight = settings.growth_pairs
    growth = (wide - middle + area * weight) / (middle - near + weight)
    by_chance = (wide - near) / (np.clip(growth, line, area) ** 2 - 1.0)
    most = settings.excess * by_chance + settings.excess_sd * by_chance**0.5 + settings.excess_pairs
    return float(radii[0, near > most].max(initial=0.0))


def distinct_places(xyz: Array, kind: NDArray[np.str_], within: float) -> tuple[Ints, Ints]:
    """Return the rows of the first point of every place and type, in order, and which of these (n,) each
    point is. Points further down change no place of those before. Points `inside` share a place only where
    they are equal.
    """
    _, first, same = np.unique(_by_type(xyz, kind, 1.0), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    rows = first[order]
    of_point = rank[same.ravel()]
    if within == 0.0:
        return rows, of_point
    pairs = cKDTree(_by_type(xyz[rows], kind[rows], within)).query_pairs(within, output_type="ndarray")
    pairs = pairs[kind[rows][pairs[:, 0]] != "inside"]
    leader = np.arange(len(rows))
    # by the later point, so that the earlier one's place is known
    for one, other in pairs[np.lexsort(pairs.T)].tolist():
        if leader[one] == one and leader[other] == other:
            leader[other] = one
    leaders, place = np.unique(leader, return_inverse=True)
    return rows[leaders], place[of_point]


def wall_places(xyz: Array, size: float) -> tuple[Ints, Ints]:
    """Return what `distinct_places` does, for points (n, d) of the wall on a prior of rms radius `size`: many
    beats of one contact count once, else they alone judge a pose.
    """
    kind = np.full(len(xyz), "eam")
    return distinct_places(xyz, kind, duplicate_distance(xyz, kind, size))


def _by_type(xyz: Array, kind: NDArray[np.str_], distance: float) -> Array:
    """Return positions (n, d + 1) in which points of different types are farther apart than a distance."""
    return np.column_stack([xyz, 2.0 * distance * np.unique(kind, return_inverse=True)[1]])
