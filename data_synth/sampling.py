"""Where points are taken on a surface, and what a catheter measures there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from o3dls import Surface

from .shapes import Array

Mask = NDArray[np.bool_]
Rows = NDArray[np.int64]

APART = 0.7  # of the side of each site's square; circles at random that exclude each other jam at 0.83
TRIED = 10  # sites for each that a filter keeps


@dataclass(frozen=True, eq=False)
class Sites:
    """Points (n, d) on a surface: the face of each and the barycentric weights (n, 3) within it."""

    xyz: Array
    face: Rows
    weights: Array

    def on(self, surface: Surface) -> Sites:
        """The same sites of the same wall where it has moved to."""
        return Sites(
            (surface.vertices[surface.faces[self.face]] * self.weights[:, :, None]).sum(axis=1),
            self.face,
            self.weights,
        )

    def read(self, surface: Surface, values: Array) -> Array:
        """Values (n,) at the sites of a quantity given per vertex."""
        return np.asarray((values[surface.faces[self.face]] * self.weights).sum(axis=1))


def sites(rng: np.random.Generator, surface: Surface, n: int, density: NDArray[Any] | float = 1.0) -> Sites:
    """n random sites on a 3D surface, uniform by area but for a relative density per face (m,)."""
    chance = surface.face_areas * density
    face = rng.choice(len(surface.faces), n, p=chance / chance.sum())
    root = np.sqrt(rng.uniform(size=n))
    other = rng.uniform(size=n)
    weights = np.column_stack([1.0 - root, root * (1.0 - other), root * other])
    return Sites((surface.vertices[surface.faces[face]] * weights[:, :, None]).sum(axis=1), face, weights)


def filtered(
    rng: np.random.Generator, surface: Surface, n: int, density: NDArray[Any] | float = 1.0
) -> Sites:
    """n sites as a density filter leaves them: of those that come one after the other, a site that is nearer
    than a distance to one that was kept is dropped. The distance is `APART` of a square's side, were each
    site given one; where it leaves too few, the next are taken as they come.
    """
    at = sites(rng, surface, TRIED * n, density)
    area = float((surface.face_areas * (np.asarray(density) > 0.0)).sum())
    near = cKDTree(at.xyz).query_ball_point(at.xyz, APART * np.sqrt(area / n))
    dropped = np.zeros(len(near), dtype=bool)
    for k, others in enumerate(near):
        if not dropped[k]:
            dropped[[other for other in others if other > k]] = True
    rows = np.argsort(dropped, kind="stable")[:n]
    return Sites(at.xyz[rows], at.face[rows], at.weights[rows])


def centres(surface: Surface) -> Array:
    """Centre (m, d) of every face."""
    return np.asarray(surface.vertices[surface.faces].mean(axis=1))


def patches(surface: Surface, middles: ArrayLike, share: float) -> Mask:
    """Faces (m,) nearest to any of the given points that together make up `share` of the area."""
    away = np.linalg.norm(centres(surface)[:, None] - np.atleast_2d(middles), axis=2).min(axis=1)
    order = np.argsort(away, kind="stable")
    chosen = np.zeros(len(away), dtype=bool)
    chosen[order] = np.cumsum(surface.face_areas[order]) <= share * surface.area
    return chosen


def clustered(
    rng: np.random.Generator, surface: Surface, allowed: Mask, *, clusters: int = 14, width: float = 5.0
) -> Array:
    """Density (m,) of a mapping catheter: two thirds of the points lie in random clusters, the others evenly;
    none outside `allowed`.
    """
    areas = surface.face_areas * allowed
    about = centres(surface)[rng.choice(len(areas), clusters, p=areas / areas.sum())]
    heap = np.exp(-((centres(surface)[:, None] - about) ** 2).sum(axis=2) / (2.0 * width**2))
    return np.asarray(allowed * (1.0 / areas.sum() + 2.0 * (heap / (areas @ heap)).mean(axis=1)))


def activation(surface: Surface, source: ArrayLike, velocity: float = 0.8) -> Array:
    """Local activation time (n,) in ms per vertex: way along the surface's edges from the source, at
    `velocity` mm/ms.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    # each edge once in each direction
    a = surface.faces.ravel()
    b = np.roll(surface.faces, -1, axis=1).ravel()
    length = np.linalg.norm(surface.vertices[a] - surface.vertices[b], axis=1)
    first = int(np.argmin(np.linalg.norm(surface.vertices - np.asarray(source), axis=1)))
    ways = dijkstra(coo_array((length, (a, b)), shape=(len(surface.vertices),) * 2), indices=[first])
    return np.asarray(ways[0] / velocity)


def voltage(
    surface: Surface, scar: ArrayLike, radius: float = 9.0, healthy: float = 2.5, low: float = 0.2
) -> Array:
    """Bipolar voltage (n,) in mV per vertex: low within a scar, healthy elsewhere, with a border zone of 2
    mm.
    """
    away = np.linalg.norm(surface.vertices - np.asarray(scar), axis=1)
    return np.asarray(low + (healthy - low) / (1.0 + np.exp(-(away - radius) / 2.0)))
