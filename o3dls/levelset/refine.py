"""From a moved prior to its refined level set: corrections by evidence, and no tear or merger without it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Ints
from ..geometry.closest_point import ClosestPoint
from ..geometry.components import piece_areas, topology
from ..geometry.surface import Surface
from .correction import Correction, Limits, refine
from .distance import SignedDistance, signed_distance
from .isosurface import zero_set
from .normal_displacement import Wall
from .observation import Measured
from .operators import without_shreds

HALF_BAND = 3.0  # half width of the band of phi, in spacings
JOINT = (
    0.5  # diagonals of a cell: half the thickness of a sheet, however it lies, that the lattice cannot miss
)
COARSE = "walls are closer than the lattice tells apart"
Mesher = Callable[[SignedDistance], tuple[Array, Ints]]
Crossing = Callable[[Surface], NDArray[np.bool_]]
# spacings: the least that makes a wall whole which runs into itself
CLOSINGS = np.array([0.5, 1.0, 2.0, 3.0])
# for what a fold has pinched off, before that goes, and for a correction, before it is halved
JOININGS = CLOSINGS[:2]


@dataclass(frozen=True, eq=False)
class Reached:
    """A level set phi, the wall that it is the signed distance of (with fields per vertex), and how it was
    reached.
    """

    phi: SignedDistance
    wall: Surface
    sigma: float
    status: str
    converged: bool
    trace: tuple[Mapping[str, float], ...] = ()
    warnings: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    unchanged: bool = False  # whether nothing was added to the moved prior
    # whether pieces beside the largest belong to the result: those of the wall, or what the paper's forces
    # cut off
    islands: bool = False

    @property
    def smallest(self) -> float:
        """Area of the wall's smallest piece, over that of its largest; 1 where no other than the largest
        stays.
        """
        if not self.islands:
            return 1.0
        _, areas = piece_areas(self.wall)
        return float(areas.min() / areas.max())

    def faults(self, mesh: Surface, crossing: Crossing) -> tuple[str, ...]:
        """What a mesh of phi has that the wall has not, as a warning; nothing where islands belong to the
        result.
        """
        found = topology(mesh.vertices, mesh.faces)
        meant = topology(self.wall.vertices, self.wall.faces)
        if found == meant or (self.islands and meant[0] == 1):
            return ()
        why = (
            "where that runs into itself, walls are united"
            if crossing(self.wall).any()
            else f"{COARSE}; try a smaller spacing"
        )
        return (f"the mesh has pieces and Euler number {found}, the moved prior {meant}: {why}",)


def reach(
    surface: Surface,
    observe: Callable[[Wall], Measured],
    doubt: Array,
    limits: Limits,
    *,
    mesh: Mesher,
    crossing: Crossing,
) -> Reached:
    """Refine a surface by corrections along its normals.

    observe: the points as seen from a wall; doubt (v,): relative standard deviation that the motion leaves at
    every vertex; mesh: what will mesh phi, since methods cut cells of ambiguous signs differently, and it is
    the mesh that has to be whole; crossing: which faces (m,) of a surface cut through others. The result is
    the surface itself where there is nothing to add.
    """
    wall = Wall(surface)
    measured = observe(wall)
    found = refine(wall, measured, doubt, limits)
    final, phi, warnings = _settled(wall, found, limits, mesh, crossing)
    sigma = found.noise * float(np.median(measured.likelihood.sigma))
    facts = {"fields": [f.record for f in found.fields], "band_nodes": len(phi.band)}
    several = topology(wall.rest, wall.faces)[0] > 1
    return Reached(
        phi,
        final,
        sigma,
        found.status,
        found.converged,
        found.trace,
        warnings,
        facts,
        not found.fields,
        several,
    )


def _settled(
    wall: Wall, found: Correction, limits: Limits, mesh: Mesher, crossing: Crossing
) -> tuple[Surface, SignedDistance, tuple[str, ...]]:
    """The corrected wall and its level set: gaps are closed where it runs into itself; a correction that
    tears or merges it is halved.

    Where a wall runs into itself all the same it is united; the mesh may still come out whole.
    """
    kind = topology(wall.rest, wall.faces)
    spacing = limits.spacing
    crossing = cache(crossing)
    for share in (1.0, 0.5, 0.25, 0.0) if found.fields else (0.0,):
        final = _corrected(wall, share * found.u)
        for phi, radius, left in _attempts(
            final, spacing, kind, CLOSINGS if share == 0.0 else JOININGS, crossing
        ):
            if topology(*mesh(phi)) == kind:
                said = []
                if found.fields and share < 1.0:
                    said.append(
                        f"the correction was taken by {share:.0%}: more would tear or merge the surface"
                    )
                if radius > 0.0:
                    left = [f"gaps narrower than {2.0 * radius:g} {limits.unit} were closed", *left]
                if left:
                    crosses = crossing(final).any()
                    lost = ", ".join(left)
                    said.append(
                        f"the moved prior runs into itself: {lost}"
                        if crosses
                        else f"{COARSE}: {lost}; try a smaller spacing"
                    )
                return final, phi, tuple(said)
    phi = _whole(_band(final, spacing, 0.0, inverted=False), kind)
    if not found.fields:
        return final, phi, ()
    # the wall comes out otherwise without the correction too: then that must do no harm
    corrected = _corrected(wall, found.u)
    after = _whole(_band(corrected, spacing, 0.0, inverted=False), kind)
    if topology(*mesh(after)) == topology(*mesh(phi)):
        return corrected, after, ()
    return (
        final,
        phi,
        (
            "the correction was left out: with it, no surface of one lattice would be whole; try a "
            "smaller spacing",
        ),
    )


def _corrected(wall: Wall, u: Array) -> Surface:
    """The wall moved by u (v,) along its normals, and u as a field."""
    return Surface(
        wall.rest + u[:, None] * wall.normals, wall.faces, {**wall.surface.fields, "correction": u}
    )


Attempt = tuple[SignedDistance, float, list[str]]


def _attempts(
    surface: Surface, spacing: float, kind: tuple[int, int], closings: Array, crossing: Crossing
) -> Iterator[Attempt]:
    """Level sets of a surface that should be of a topology, the radius of the closing in them, and what was
    done or left out: with all that it encloses, since the tip of a rim that a fold turned inside out is
    anatomy, joined to the rest where walls cross; then without shreds; then without what is inside out.
    """
    band = cache(lambda wall, radius, inverted: _band(wall, spacing, radius, inverted=inverted))
    yield band(surface, 0.0, True), 0.0, []
    joined = _joined(surface, spacing, crossing(surface))
    said = [] if joined is surface else ["walls that cross were joined"]
    if said:
        yield band(joined, 0.0, True), 0.0, said
    for radius in JOININGS * spacing:
        yield _closed(band(joined, radius, True), radius), radius, said
    left_out = (
        (joined, True, [*said, "shreds were left out"]),
        (surface, False, ["shreds and what is inside out were left out"]),
    )
    for wall, inverted, lost in left_out:
        for radius in (0.0, *closings * spacing):
            yield _whole(_closed(_whole(band(wall, radius, inverted), kind), radius), kind), radius, lost


def _joined(surface: Surface, spacing: float, crossing: NDArray[np.bool_]) -> Surface:
    """A surface that encloses all that this one does and, around its faces that cross, what is nearer to them
    than half a joint: where the walls of a thin part have passed through each other, it is thin, and neither
    of no thickness nor in two.
    """
    if not crossing.any():
        return surface
    radius = JOINT * spacing * surface.dimension**0.5
    phi = _band(surface, spacing, radius, inverted=True)
    around = np.zeros(len(surface.vertices), dtype=bool)
    around[surface.faces[crossing]] = True
    walls = ClosestPoint(surface.vertices, surface.faces[around[surface.faces].any(axis=1)])
    joint = np.sqrt(walls.query(phi.band.positions)[0]) - radius
    return Surface(*zero_set(phi.band, np.minimum(phi.phi, joint)))


def _band(surface: Surface, spacing: float, radius: float, *, inverted: bool) -> SignedDistance:
    """The signed distance of a surface, so wide that something is left when it grows by the radius."""
    return signed_distance(
        surface.vertices, surface.faces, spacing, radius + HALF_BAND * spacing, inverted=inverted
    )


def _closed(phi: SignedDistance, radius: float) -> SignedDistance:
    """The level set grown by a radius and shrunk again: tunnels and gaps that a ball of the radius does not
    enter are gone.
    """
    if radius == 0.0:
        return phi
    grown = signed_distance(
        *zero_set(phi.band, phi.phi - radius), phi.band.spacing, radius + 2.0 * phi.band.spacing
    )
    return replace(grown, phi=grown.phi + radius)


def _whole(phi: SignedDistance, kind: tuple[int, int]) -> SignedDistance:
    """The level set of a surface in one piece, without the shreds that a folded wall leaves."""
    return phi if kind[0] > 1 else replace(phi, phi=without_shreds(phi.band, phi.phi))
