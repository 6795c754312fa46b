"""Segments of the left atrium by the rules of the EHRA/EACVI consensus of 2025 (Althoff et al., Europace 27,
euaf134), as far as they could be read in public: docs/segments.md.

Letters are the paper's: A and B are the upper and the lower place where the left antrum meets the dome, C and
D those of the right one; E, F, H and I stand on the mitral annulus at 9, 1, 4 and 7 o'clock, seen from the
ventricle. Borders are shortest ways along the wall between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from ...arrays import Array, Ints, Mask
from ...geometry.surface import Surface
from ..wall_graph import keep_edges, label_pieces, measure_way
from .openings import Openings

VALVE = 0
SEGMENTS = {
    VALVE: "mitral valve",
    1: "left pulmonary venous antrum",
    2: "right pulmonary venous antrum",
    3: "dome (posterior wall)",
    4: "anterior wall",
    5: "left atrial appendage",
    6: "lateral wall",
    7: "inferior wall",
    8: "septal wall",
}
LEFT, RIGHT, APPENDAGE = 1, 2, 5
CLOCK = {"E": 9.0, "F": 1.0, "H": 4.0, "I": 7.0}  # hours on the annulus, seen from the ventricle
# what each segment of the wall borders on: ways between places, parts of the annulus, openings
BORDERS = {
    3: ("AC", "BD", "left", "right"),
    4: ("AC", "EC", "EF", "AF", "appendage"),
    6: ("AF", "FH", "HB", "left", "appendage"),
    7: ("BD", "HI", "HB", "DI"),
    8: ("IE", "EC", "DI", "right"),
}
MEDIAL = 0.5  # how much a place towards the middle counts beside one that is higher or lower, for A to D
CARINA = 4.0  # mm longer than the shortest way between two veins of a side: what lies there is antrum
SLIVER = 0.01  # of the wall's area: smaller pieces belong to what surrounds them


@dataclass(frozen=True, eq=False)
class Division:
    """A division has the segment (n,) of each vertex, a key of `SEGMENTS`, and the places (3,) by letter that
    its borders lead to.
    """

    segment: Ints
    places: Mapping[str, Array]


def divide(surface: Surface, openings: Openings, places: Mapping[str, Array] | None = None) -> Division:
    """Divide a left atrium into segments.

    places: those (3,) of the letters that somebody has placed; each moves to the rim that it belongs to. A
    vertex on a border belongs to the segment that is nearest along the wall; pieces between borders are
    named by what they border on.
    """
    left, right = (_make_antrum(openings, letter) for letter in "LR")
    appendage = openings.tubes["LAA"].inside if "LAA" in openings.tubes else np.zeros_like(left)
    valve = openings.valve.inside & ~(left | right | appendage)
    right, appendage = right & ~left, appendage & ~left & ~right
    wall = ~(left | right | appendage | valve)
    parts = {"left": left, "right": right, "appendage": appendage}
    main = label_pieces(openings.edges, wall) == 0
    rims = [_find_rim(openings.edges, part, main) for part in (left, right, valve)]
    at = _place_letters(surface, openings, *rims, places=places or {})
    ways = _draw_ways(openings.edges, wall, at, appendage)
    segment = np.where(left, LEFT, np.where(right, RIGHT, np.where(appendage, APPENDAGE, -1)))
    segment[valve] = VALVE
    arcs = _name_arcs(surface, openings, valve)
    free = wall & ~np.any(list(ways.values()), axis=0)
    _name_pieces(surface, openings.edges, free, parts | ways | arcs, segment)
    _fill_borders(openings.edges, wall, segment)
    return Division(segment, {letter: surface.vertices[vertex] for letter, vertex in at.items()})


def _make_antrum(openings: Openings, letter: str) -> Mask:
    """Return the vertices (n,) of the veins of a side and of the wall between them."""
    veins = [tube.inside for name, tube in openings.tubes.items() if name[0] == letter and name != "LAA"]
    antrum = openings.side(letter)
    everywhere = np.ones(len(antrum), dtype=bool)
    if len(veins) == 2:
        a, b = (measure_way(openings.edges, one, everywhere) for one in veins)
        antrum = antrum | (a + b < a[veins[1]].min() + CARINA)
    outside = label_pieces(openings.edges, ~antrum)
    return np.asarray(antrum | (outside > 0))  # what it encloses belongs to it


def _find_rim(edges: sparse.coo_array, mask: Mask, beside: Mask) -> Mask:
    """Return the vertices (n,) of a mask that have a neighbour in another one."""
    rim = np.zeros(len(mask), dtype=bool)
    for here, there in (edges.coords, edges.coords[::-1]):
        rim[here[mask[here] & beside[there]]] = True
    return rim


def _place_letters(
    surface: Surface, openings: Openings, *rims: Mask, places: Mapping[str, Array]
) -> dict[str, int]:
    """Return the vertex of each letter on the rims of the left and the right antrum and of the valve."""
    to_left, _, up = openings.axes
    left, right, annulus = map(np.flatnonzero, rims)
    found = dict[str, int]()
    for letters, rim, medial in (("AB", left, -to_left), ("CD", right, to_left)):
        for letter, way in zip(letters, (up, -up), strict=True):
            found[letter] = int(rim[(surface.vertices[rim] @ (way + MEDIAL * medial)).argmax()])
    hour = _read_clock(surface.vertices[annulus], openings)
    for letter, at in CLOCK.items():
        found[letter] = int(annulus[np.abs((hour - at + 6.0) % 12.0 - 6.0).argmin()])
    for letter, place in places.items():
        rim = left if letter in "AB" else right if letter in "CD" else annulus
        found[letter] = int(rim[np.linalg.norm(surface.vertices[rim] - place, axis=1).argmin()])
    return found


def _read_clock(points: Array, openings: Openings) -> Array:
    """Return the hour (n,) at which points (n, 3) stand on the annulus, seen from the ventricle."""
    normal, up = openings.valve.normal, openings.axes[2]
    noon = up - (up @ normal) * normal
    noon = noon / np.linalg.norm(noon)
    three = np.cross(noon, normal)
    offset = points - openings.valve.middle
    return np.asarray(np.arctan2(offset @ three, offset @ noon) * 6.0 / np.pi % 12.0)


def _draw_ways(
    edges: sparse.coo_array, wall: Mask, at: Mapping[str, int], appendage: Mask
) -> dict[str, Mask]:
    """Return the vertices (n,) on each way between letters, along the wall alone."""
    ways = {
        name: _draw_way(edges, wall, [at[name[0]]], [at[name[1]]]) for name in ("AC", "BD", "EC", "DI", "HB")
    }
    if not appendage.any():
        return ways | {"AF": _draw_way(edges, wall, [at["A"]], [at["F"]])}
    neck = np.flatnonzero(_find_rim(edges, appendage, wall))
    return ways | {"AF": _draw_way(edges, wall, [at["A"]], neck) | _draw_way(edges, wall, neck, [at["F"]])}


def _draw_way(edges: sparse.coo_array, wall: Mask, start: list[int] | Ints, end: list[int] | Ints) -> Mask:
    open_to = wall.copy()
    open_to[start] = open_to[end] = True
    way, before, _ = dijkstra(
        keep_edges(edges, open_to), directed=False, indices=start, min_only=True, return_predecessors=True
    )
    vertex = int(np.asarray(end)[way[end].argmin()])
    found = np.zeros(len(wall), dtype=bool)
    while vertex >= 0:
        found[vertex] = True
        vertex = int(before[vertex])
    return found


def _name_arcs(surface: Surface, openings: Openings, valve: Mask) -> dict[str, Mask]:
    """Return the vertices (n,) of the valve by the part of the annulus that they are nearest to."""
    hour = _read_clock(surface.vertices, openings)
    return {
        a + b: valve & ((hour - CLOCK[a]) % 12.0 < (CLOCK[b] - CLOCK[a]) % 12.0)
        for a, b in ("EF", "FH", "HI", "IE")
    }


def _name_pieces(
    surface: Surface, edges: sparse.coo_array, free: Mask, things: Mapping[str, Mask], segment: Ints
) -> None:
    """Name the pieces of the wall between the borders, in place: each by the segment most of whose borders
    it has. A segment that is left over shares the piece that has most of its own borders, as where a handle
    of the surface leads round a border: a vertex belongs to the one whose own borders are nearer.
    """
    piece = label_pieces(edges, free)
    named = dict[int, int]()
    touched = dict[int, dict[str, Mask]]()
    for k in range(piece.max() + 1):
        if surface.vertex_areas[piece == k].sum() < SLIVER * surface.area:
            continue
        touched[k] = {name: _find_rim(edges, piece == k, thing) for name, thing in things.items()}
        named[k] = max(BORDERS, key=lambda one: _count_borders(touched[k], BORDERS[one]))
        segment[piece == k] = named[k]
    for one in BORDERS.keys() - set(named.values()):
        own = {k: set(BORDERS[one]) - set(BORDERS[name]) for k, name in named.items()}
        k = max(named, key=lambda k: sum(touched[k][name].sum() for name in own[k]))
        theirs = set(BORDERS[named[k]]) - set(BORDERS[one])
        near, far = (
            measure_way(edges, np.any([touched[k][name] for name in names], axis=0), piece == k)
            for names in (own[k], theirs)
        )
        segment[(piece == k) & (near < far)] = one


def _count_borders(touched: Mapping[str, Mask], names: tuple[str, ...]) -> int:
    """Return how many vertices border on what is named, less those that border on anything else."""
    return sum(int(rim.sum()) * (1 if name in names else -1) for name, rim in touched.items())


def _fill_borders(edges: sparse.coo_array, wall: Mask, segment: Ints) -> None:
    """Give vertices of the wall that have no segment that of the nearest one that has, in place: along the
    wall, and across openings where these surround it.
    """
    for within in (wall, np.ones_like(wall)):
        known = np.flatnonzero(within & (segment >= 0))
        nearest = dijkstra(
            keep_edges(edges, within), directed=False, indices=known, min_only=True, return_predecessors=True
        )[2]
        left = wall & (segment < 0) & (nearest >= 0)
        segment[left] = segment[nearest[left]]
