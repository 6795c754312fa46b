"""Regions of the left atrium's wall by the patient's axes and named places."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..arrays import Array, Ints, Mask
from ..geometry.surface import Surface
from ..registration.landmark_names import VEINS, partners
from .wall_graph import keep_edges, measure_depths, measure_edges, measure_way

# by the direction from the chamber's middle: left, front, up; the sign that each has
SIDES = {
    "lateral": (0, 1.0),
    "septal": (0, -1.0),
    "anterior": (1, 1.0),
    "posterior": (1, -1.0),
    "roof": (2, 1.0),
    "floor": (2, -1.0),
}
OPENINGS = (*VEINS, "LAA", "MA")
UNNAMED = "tube"  # a vein or an appendage that no landmark names
REGIONS = (*SIDES, *OPENINGS, UNNAMED)
WORDS = {
    "LAA": "appendage",
    "MA": "mitral annulus",
    UNNAMED: "vein or appendage without a landmark",
} | {name: f"ostium {name}" for name in VEINS}
VALVE = REGIONS.index("MA")
REACH, OPENS = 10.0, 0.5  # mm about a landmark, and as much more per mm beyond it: veins need not be straight
ANNULUS = 15.0  # mm about the middle of the valve, which is some 35 mm across
DEEP, LONG = 5.0, 9.0  # mm out of the chamber: where a tube begins, and how far one has to reach
LEFT, RIGHT = ("LSPV", "LIPV", "LCPV"), ("RSPV", "RMPV", "RIPV", "RCPV")


def regions(surface: Surface, axes: Array, landmarks: Mapping[str, Array]) -> Ints | None:
    """Return the region of each vertex (n,) of a left atrium, a place in `REGIONS`; None where no vein of
    either side is named, so that nothing says that it is one.

    axes (3, 3): unit directions to the patient's left, front and head; landmarks (3,) by name, all in the
    frame of the surface, in mm. A vertex belongs to one of the `openings`, or to the side to which it lies
    farthest from the middle, in standard deviations of the chamber along each axis.
    """
    places = _find_places(landmarks)
    if not (places.keys() & set(LEFT) and places.keys() & set(RIGHT)):
        return None
    opening = openings(surface, landmarks)
    wall = opening < 0
    area = surface.vertex_areas
    offset = (surface.vertices - _find_middle(surface)) @ axes.T
    spread = np.sqrt((area * wall) @ offset**2 / (area @ wall))
    sides = np.column_stack([sign * offset[:, k] / spread[k] for k, sign in SIDES.values()])
    return np.asarray(np.where(wall, sides.argmax(axis=1), opening), dtype=np.int64)


def openings(surface: Surface, landmarks: Mapping[str, Array]) -> Ints:
    """Return the vein, the appendage or the valve that each vertex (n,) belongs to, a place in `REGIONS`; -1
    on the chamber's wall.

    landmarks (3,) by name, in mm and in the frame of the surface; names of no opening say nothing. A vertex
    belongs to a landmark within 10 mm of which it lies (15 mm of the middle of the valve), or of the
    half-line from it away from the chamber's middle, and half a mm more per mm along that; or where it lies
    in the same tube, wherever in it the landmark is. Tubes of 9 mm without a landmark are `UNNAMED`.
    """
    places = _find_places(landmarks)
    return _find_openings(surface, tuple((name, *map(float, at)) for name, at in places.items()))


@lru_cache(maxsize=4)  # pictures, tables and the advice ask for the same surface
def _find_openings(surface: Surface, named: tuple[tuple[Any, ...], ...]) -> Ints:
    places = {name: np.array(at) for name, *at in named}
    middle = _find_middle(surface)
    depth = measure_depths(surface)
    edges = measure_edges(surface)
    reach = {name: _distance_off_axis(surface.vertices, at, middle) for name, at in places.items()}
    reach = {name: far - (ANNULUS if name == "MA" else REACH) for name, far in reach.items()}
    found = np.full(len(depth), -1)
    nearest = np.full(len(depth), np.inf)
    for name in places:
        begin = reach[name] <= 0.0
        along = measure_way(edges, begin, (depth > DEEP) & (name != "MA"))
        along = np.where(begin, reach[name], along)
        closer = along < nearest
        found[closer], nearest[closer] = REGIONS.index(name), along[closer]
    return _add_unnamed(edges, depth, found)


def valve_of(surface: Surface, landmarks: Mapping[str, Array]) -> Mask:
    """Return the vertices (n,) in the mitral valve, which is no wall; none where no landmark names it."""
    return np.asarray(openings(surface, landmarks) == VALVE)


def tubes(surface: Surface, landmarks: Mapping[str, Array]) -> dict[str, Mask]:
    """Return the vertices (n,) of each named vein and of the appendage that lie at least 5 mm out of the
    chamber, in one piece: what lies beyond a section of the tube. One that is shorter is left out.
    """
    of, deep, edges = openings(surface, landmarks), measure_depths(surface) > DEEP, measure_edges(surface)
    found = dict[str, Mask]()
    for name in (*VEINS, "LAA"):
        inside = deep & (of == REGIONS.index(name))
        part = connected_components(keep_edges(edges, inside), directed=False)[1]
        largest = inside & (part == np.bincount(part[inside]).argmax()) if inside.any() else inside
        if largest[surface.faces].all(axis=1).any():
            found[name] = largest
    return found


def unvisited(surface: Surface, landmarks: Mapping[str, Array], points: Array) -> list[Mask]:
    """Return the vertices (n,) of each vein and of the appendage that no point (m, 3) lies nearest to."""
    of = openings(surface, landmarks)
    seen = of[cKDTree(surface.vertices).query(points)[1]] if len(points) else of[:0]
    return [of == k for k in np.setdiff1d(of[(of >= 0) & (of != VALVE)], seen)]


def word(region: int) -> str:
    """Return what a region is called."""
    return WORDS.get(REGIONS[region], REGIONS[region])


def short_word(region: int) -> str:
    """Return what a region is called in a picture, where there is little room."""
    return "no landmark" if REGIONS[region] == UNNAMED else word(region)


def _find_places(landmarks: Mapping[str, Array]) -> dict[str, Array]:
    """Return the places of the openings that landmarks name."""
    named = list(landmarks)
    return {OPENINGS[j]: landmarks[named[i]] for i, j in partners(named, OPENINGS).items()}


def _find_middle(surface: Surface) -> Array:
    area = surface.vertex_areas
    return np.asarray(area @ surface.vertices / area.sum())


def _add_unnamed(edges: sparse.coo_array, depth: Array, found: Ints) -> Ints:
    """Return the openings with the tubes that belong to none of them."""
    left = (depth > DEEP) & (found < 0)
    part = connected_components(keep_edges(edges, left), directed=False)[1]
    long = np.unique(part[left & (depth > LONG)])
    return np.asarray(np.where(left & np.isin(part, long), REGIONS.index(UNNAMED), found), dtype=np.int64)


def _distance_off_axis(points: Array, at: Array, middle: Array) -> Array:
    """Return the distance (n,) of points (n, 3) from the half-line from a place away from the middle, less
    what it opens by along it.
    """
    out = (at - middle) / np.linalg.norm(at - middle)
    along = np.maximum((points - at) @ out, 0.0)
    return np.asarray(np.linalg.norm(points - at - along[:, None] * out, axis=1) - OPENS * along)
