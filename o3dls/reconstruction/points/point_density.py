"""How likely points are under a level set: spread evenly over its wall, with noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ...arrays import Array, Ints, Mask
from ...geometry.surface import Surface
from ...levelset.grid.band import Band
from ...levelset.grid.isosurface import zero_set
from ...parallel import each
from ..shape_settings import HandleSettings


@dataclass(frozen=True, eq=False)
class PointDensity:
    """The density is that of points (n, 3) with noise `sigma`, seen from level sets on a box of nodes (index
    + low) * spacing.
    """

    points: Array
    sigma: float
    low: Ints
    spacing: float
    settings: HandleSettings

    def log_likelihoods(self, phis: tuple[Array, ...], changed: Mask) -> list[float]:
        """Return the log density of the points near nodes (mask), as many as there are, given that they come
        from the wall of each phi near these, evenly. So wall without points costs as much as points without
        wall.
        """
        reach = self.settings.reach * self.sigma
        nodes = np.argwhere(changed)
        around = KDTree(np.asarray((nodes + self.low) * self.spacing, dtype=np.float64))
        near = KDTree(self.points[_are_within_reach(reach, around, self.points)])
        margin = int(np.ceil(2.0 * reach / self.spacing)) + 1
        low = np.maximum(nodes.min(axis=0) - margin, 0)
        box = tuple(slice(a, b + margin + 1) for a, b in zip(low, nodes.max(axis=0), strict=True))
        every = np.argwhere(np.ones(changed[box].shape, dtype=bool)).astype(np.int32)
        band = Band(self.spacing, reach, self.low + low, changed[box].shape, every)

        def log_likelihood(phi: Array) -> float:
            return self._log_likelihood(Surface(*zero_set(band, phi[box].ravel())), near, around)

        return each(log_likelihood, phis)

    def _log_likelihood(self, wall: Surface, near: KDTree, around: KDTree) -> float:
        """Return the log density of the points `near`, given that they come from the wall near the nodes
        `around`.
        """
        reach = self.settings.reach * self.sigma
        places, areas = wall.vertices[wall.faces].mean(axis=1), wall.face_areas
        if not near.n or not len(places):
            return 0.0
        whole = areas[_are_within_reach(reach, around, places)].sum()
        return log_density(near, np.full(near.n, self.sigma), wall, whole, self.settings)


def log_density(points: KDTree, noise: Array, wall: Surface, whole: float, settings: HandleSettings) -> float:
    """Return the log density of points (k) with noise (k,) that come evenly from a wall, of which an area
    `whole` counts; the centres of its faces stand for them.
    """
    places, areas = wall.vertices[wall.faces].mean(axis=1), wall.face_areas
    reach = settings.reach * float(np.median(noise))
    pairs = points.sparse_distance_matrix(KDTree(places), reach, output_type="ndarray")
    heights = areas[pairs["j"]] * np.exp(-0.5 * (pairs["v"] / noise[pairs["i"]]) ** 2)
    summed = np.bincount(pairs["i"], heights, minlength=points.n)
    density = summed / ((2.0 * np.pi) ** 1.5 * noise**3) + settings.floor / noise
    return float(np.log(density / whole).sum())


def _are_within_reach(reach: float, nodes: KDTree, places: Array) -> Mask:
    """Say which places (k, 3) are nearer than `reach` to one of the nodes."""
    return np.asarray(nodes.query(places, distance_upper_bound=reach)[0] < reach)
