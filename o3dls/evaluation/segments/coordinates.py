"""Atrial coordinates: where a place lies on any left atrium, so that maps can be laid on one another,
in the manner of the universal atrial coordinates (Roney et al., Medical Image Analysis 55, 2019).

The wall is laid flat in four sheets: the body with the mitral annulus as its rim, the two antra with their
veins, and the appendage. On each, alpha and beta are two harmonic fields within [0, 1].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ...arrays import Array, Ints
from ...errors import InputError
from ...geometry.closest_point import ClosestPoint
from ...geometry.surface import Surface, interpolated
from ..wall_graph import measure_way
from .division import APPENDAGE, CLOCK, LEFT, RIGHT, VALVE, Division
from .flattening import Flat, flatten
from .openings import Openings

BODY = 0
SHEETS = {BODY: "body", LEFT: "left antrum", RIGHT: "right antrum", APPENDAGE: "appendage"}
NOON, HOUR = np.pi / 2.0, np.pi / 6.0


@dataclass(frozen=True, eq=False)
class AtrialCoordinates:
    """Atrial coordinates have `alpha` (n,), `beta` (n,) and `sheet` (n,), a key of `SHEETS`, of each vertex
    of a surface: NaN and -1 in the mitral valve. On the body, alpha goes from the septal to the lateral side
    of the annulus, and beta from the lower to the upper one.
    """

    surface: Surface
    alpha: Array
    beta: Array
    sheet: Ints
    flat: Mapping[int, Flat]

    def find(self, alpha: Array, beta: Array, sheet: Ints) -> tuple[Ints, Array]:
        """Return the corners (k, 3), vertices of the surface, and the weights (k, 3) of the places that have
        these coordinates (k,); those of the nearest where a sheet has a hole. -1 and NaN where the atrium has
        no such sheet, or no coordinates are given.
        """
        corners, weights = np.full((len(alpha), 3), -1), np.full((len(alpha), 3), np.nan)
        for one, flat in self.flat.items():
            of = np.flatnonzero((sheet == one) & np.isfinite(alpha) & np.isfinite(beta))
            if len(of):
                raised = np.column_stack([flat.places, np.zeros(len(flat.places))])
                at = np.column_stack([2.0 * alpha[of] - 1.0, 2.0 * beta[of] - 1.0, np.zeros(len(of))])
                _, face, _, weights[of] = ClosestPoint(raised, flat.faces).query(at)
                corners[of] = flat.origin[flat.faces[face]]
        return corners, weights

    def places(self, alpha: Array, beta: Array, sheet: Ints) -> Array:
        """Return the places (k, 3) on the surface that have these coordinates (k,), NaN as in `find`."""
        return self.values(self.surface.vertices, alpha, beta, sheet)

    def values(self, field: Array, alpha: Array, beta: Array, sheet: Ints) -> Array:
        """Return the values (k, ...) of a field (n, ...) of the surface at coordinates (k,), NaN as in
        `find`.
        """
        corners, weights = self.find(alpha, beta, sheet)
        found = np.full((len(alpha), *field.shape[1:]), np.nan)
        known = corners[:, 0] >= 0
        found[known] = interpolated(np.asarray(field, dtype=np.float64), corners[known], weights[known])
        return found


def carry_field(field: Array, source: AtrialCoordinates, target: AtrialCoordinates) -> Array:
    """Return a field (n, ...) of one heart on the vertices (m, ...) of another, by their coordinates: NaN in
    its valve, and on a sheet that the first heart has not.
    """
    return source.values(field, target.alpha, target.beta, target.sheet)


def find_coordinates(surface: Surface, openings: Openings, division: Division) -> AtrialCoordinates:
    """Return the atrial coordinates of a left atrium that was divided. Raises InputError where there is no
    wall beside its openings.
    """
    segment, at = division.segment, division.places
    parts = _sort_faces(surface, openings, segment)
    clock = [(at[letter], NOON - hour * HOUR) for letter, hour in CLOCK.items()]
    ends = {
        BODY: clock,
        LEFT: [(at["A"], NOON), (at["B"], -NOON)],
        RIGHT: [(at["C"], NOON), (at["D"], -NOON)],
    }
    ends[APPENDAGE] = [(at["A"], NOON), (at["F"], -NOON)]
    flat = {}
    for one, faces in parts.items():
        depth = np.zeros(len(segment)) if one == BODY else _measure_depth(openings, faces, parts[BODY])
        flat[one] = flatten(surface, faces, ends[one], depth)
    alpha, beta, sheet = (
        np.full(len(segment), np.nan),
        np.full(len(segment), np.nan),
        np.full(len(segment), -1),
    )
    for one in (APPENDAGE, RIGHT, LEFT, BODY):  # what two have is the body's
        if one in flat:
            used = np.unique(flat[one].faces)
            vertex = flat[one].origin[used]
            alpha[vertex], beta[vertex] = (0.5 + 0.5 * flat[one].places[used]).T
            sheet[vertex] = one
    return AtrialCoordinates(surface, alpha, beta, sheet, flat)


def _sort_faces(surface: Surface, openings: Openings, segment: Ints) -> dict[int, Ints]:
    """Return the faces of each sheet, in one piece each: those of a tube have all corners in it, the body has
    what is left but for the valve.
    """
    corners = segment[surface.faces]
    whole = (corners == corners[:, :1]).all(axis=1)
    of = np.where(whole & np.isin(corners[:, 0], (LEFT, RIGHT, APPENDAGE, VALVE)), corners[:, 0], -1)
    of[of == VALVE] = -2
    found = {}
    for one in (LEFT, RIGHT, APPENDAGE):
        inside = np.flatnonzero(of == one)
        if len(inside):
            kept = inside[_largest_piece(surface.faces[inside])]
            of[np.setdiff1d(inside, kept)] = -1
            found[one] = surface.faces[kept]
    body = np.flatnonzero(of == -1)
    if len(body) == 0:
        raise InputError("the wall of the surface has nothing but openings: must be a left atrium")
    found[BODY] = surface.faces[body[_largest_piece(surface.faces[body])]]
    return found


def _largest_piece(faces: Ints) -> Ints:
    """Return which faces are of the largest piece that hangs together by edges."""
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    key = sides[:, 0] * (int(faces.max()) + 1) + sides[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    a, b = order[:-1][same] // 3, order[1:][same] // 3
    graph = sparse.coo_array((np.ones(len(a)), (a, b)), shape=(len(faces), len(faces)))
    label = connected_components(graph, directed=False)[1]
    return np.flatnonzero(label == np.bincount(label).argmax())


def _measure_depth(openings: Openings, faces: Ints, body: Ints) -> Array:
    """Return how far (n,) the vertices of a tube lie from its rim, along the wall, mm."""
    inside = np.zeros(len(openings.valve.inside), dtype=bool)
    rim = inside.copy()
    inside[faces], rim[body] = True, True
    way = measure_way(openings.edges, inside & rim, inside)
    return np.where(np.isfinite(way), way, 0.0)
