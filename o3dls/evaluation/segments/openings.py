"""Openings of a left atrium: its veins, its appendage and its valve, named by landmarks or found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from ...arrays import Array, Mask
from ...errors import InputError
from ...geometry.surface import Surface
from ...registration.landmark_names import partners
from ..wall_graph import measure_depths, measure_edges
from .naming import CUT, FAR, TEMPLATE, VALVE, VALVE_NORMAL, measure_chamber, name_tubes
from .tubes import Tube, find_tubes
from .valve import Expected, Valve, find_valve

NEAR, UNSURE = 8.0, 0.3  # deviation of a valve from its landmark, mm; from the mean place, in rms radii
LOBE = 25.0  # mm: a tube whose mouth is nearer to that of a named one is a branch, or a lobe, of it


@dataclass(frozen=True, eq=False)
class Openings:
    """Openings have the vertices (n,) of each tube by its name and the valve; `axes` (3, 3) are unit
    directions to the patient's left, front and head in rows; `edges` are those of the surface.
    """

    tubes: Mapping[str, Tube]
    valve: Valve
    axes: Array
    edges: sparse.coo_array

    def side(self, letter: str) -> Mask:
        """Return the vertices (n,) of the veins of one side, "L" or "R"."""
        veins = [one.inside for name, one in self.tubes.items() if name[0] == letter and name != "LAA"]
        return np.any(veins, axis=0) if veins else np.zeros(len(self.valve.inside), dtype=bool)

    def landmarks(self) -> dict[str, Array]:
        """Return the named places (3,): the middle of each tube's mouth, and that of the valve."""
        return {name: tube.mouth for name, tube in self.tubes.items()} | {"MA": self.valve.middle}


def find_openings(
    surface: Surface, landmarks: Mapping[str, Array] | None = None, axes: Array | None = None
) -> Openings:
    """Find and name the veins, the appendage and the valve of a left atrium, closed, in mm.

    landmarks: places (3,) by name; what they do not name is found. axes (3, 3): unit directions to the
    patient's left, front and head in rows, where they are known. Raises InputError where the surface has no
    vein on one of its sides, so that it is no left atrium.
    """
    edges = measure_edges(surface)
    places = _read_places(landmarks or {})
    tubes, given = _claim_tubes(surface, find_tubes(surface, edges, measure_depths(surface)), places)
    naming = name_tubes(surface, tubes, axes, given)
    named = {name: tubes[k] for name, k in naming.tubes.items()}
    if not ({"LSPV", "LIPV", "LCPV"} & named.keys() and {"RSPV", "RIPV", "RCPV"} & named.keys()):
        raise InputError(
            "no pulmonary veins were found on both sides of the surface: must be the closed surface of a "
            "left atrium in mm, with its veins"
        )
    spare = [tube for k, tube in enumerate(tubes) if k not in naming.tubes.values()]
    middle, size = measure_chamber(surface, tubes)
    at = middle + size * np.array(VALVE) @ naming.axes
    named = _join_lobes(named, spare, at)
    chamber = ~np.any([tube.inside for tube in named.values()], axis=0)
    normal = np.array(VALVE_NORMAL) @ naming.axes
    expected = Expected(
        normal / np.linalg.norm(normal), places.get("MA", at), NEAR if "MA" in places else UNSURE * size
    )
    valve = find_valve(surface, edges, chamber, expected)
    return Openings(named, valve, naming.axes if axes is None else axes, edges)


def _read_places(landmarks: Mapping[str, Array]) -> dict[str, Array]:
    """Return the landmarks of openings by the names of this package."""
    names, known = list(landmarks), (*TEMPLATE, "MA")
    return {known[j]: np.asarray(landmarks[names[i]]) for i, j in partners(names, known).items()}


def _claim_tubes(
    surface: Surface, tubes: list[Tube], places: Mapping[str, Array]
) -> tuple[list[Tube], dict[str, int]]:
    """Return the tubes, those that landmarks name first, and the name of each of these: the tube whose mouth
    or wall is nearest to the landmark, of those that no other landmark is nearer to. A landmark with none
    near gets a tube of its own.
    """
    veins = {name: at for name, at in places.items() if name in TEMPLATE}
    names, claimed = list(veins), dict[str, int]()
    gap = np.array([[_distance(surface, at, tube) for tube in tubes] for at in veins.values()])
    for flat in np.argsort(gap, axis=None):
        name, tube = names[flat // len(tubes)], int(flat % len(tubes))
        if name not in claimed and tube not in claimed.values() and gap.ravel()[flat] < FAR:
            claimed[name] = tube
    first = [tubes[claimed[name]] if name in claimed else _cut_tube(surface, veins[name]) for name in names]
    rest = [tube for k, tube in enumerate(tubes) if k not in claimed.values()]
    return [*first, *rest], {name: k for k, name in enumerate(names)}


def _cut_tube(surface: Surface, at: Array) -> Tube:
    """Return the wall about a landmark of a vein that was cut where it begins."""
    return Tube(np.linalg.norm(surface.vertices - at, axis=1) < CUT, at, CUT)


def _distance(surface: Surface, at: Array, tube: Tube) -> float:
    wall = np.linalg.norm(surface.vertices[tube.inside] - at, axis=1).min()
    return float(min(wall, np.linalg.norm(tube.mouth - at)))


def _join_lobes(named: dict[str, Tube], spare: Sequence[Tube], valve: Array) -> dict[str, Tube]:
    """Return the named tubes with those without a name whose mouths are near theirs, and not nearer to where
    the valve is expected: further veins of a side, and lobes of the appendage.
    """
    joined = dict(named)
    for tube in spare:
        gap = {name: np.linalg.norm(one.mouth - tube.mouth) for name, one in named.items()}
        name = min(gap, key=lambda one: gap[one])
        if gap[name] < min(LOBE, float(np.linalg.norm(valve - tube.mouth))):
            joined[name] = replace(joined[name], inside=joined[name].inside | tube.inside)
    return joined
