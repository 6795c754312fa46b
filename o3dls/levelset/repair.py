"""A surface that runs into itself: relaxed where it does, or its level set closed, joined or cut until it is
whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ..arrays import Array, Ints, Mask
from ..geometry.closest_point import ClosestPoint
from ..geometry.components import components_and_euler
from ..geometry.flipped_faces import flipped, relaxed
from ..geometry.surface import Surface
from ..run_warning import RunWarning
from .grid.distance import SignedDistance, around_zero, signed_distance
from .grid.operators import without_islands
from .grid.simple_points import simply_connected
from .settings import LatticeSettings

Crossing = Callable[[Surface], Mask]
Mesher = Callable[[SignedDistance], tuple[Array, Ints]]


def whole_level_set(
    surface: Surface, spacing: float, unit: str, *, mesh: Mesher, crossing: Crossing
) -> tuple[SignedDistance, tuple[RunWarning, ...]]:
    """Return the signed distance of a closed surface that runs into itself, on a lattice of a spacing, whose
    mesh has the surface's topology; and a warning where that took a repair.

    unit: of lengths in sentences; mesh: what will mesh phi, since methods cut cells of ambiguous signs
    differently, and it is the mesh that has to be whole; crossing: which faces (m,) of a surface cut through
    others. Where no repair makes it whole, it is united: what it encloses twice is inside.
    """
    kind = components_and_euler(surface.vertices, surface.faces)
    repair = Repair(spacing, kind, crossing, LatticeSettings(), mesh)
    for attempt in repair.attempts(surface):
        if components_and_euler(*mesh(attempt.phi)) == kind:
            return attempt.phi, _warn_of_repair(attempt, unit)
    return repair.united(surface), ()


def relaxed_in_place(
    surface: Surface, flips: int, most: float, unit: str, crossing: Crossing
) -> tuple[Surface, tuple[RunWarning, ...]] | None:
    """Return a closed surface whose faces do not cross, and of which at most so many are flipped over:
    itself, or, where a few do or are, with the vertices there moved between their neighbours, and a warning
    where faces crossed; None where that leaves others, or moves a vertex by more than a length `most`.

    flips: how many flipped faces the prior had; unit: of lengths in sentences; crossing: which faces (m,) of
    a surface cut through others.
    """
    crossed, folded = crossing(surface).any(), flipped(surface).sum() > flips
    rings = LatticeSettings().most_rings
    if not crossed and not folded:
        return surface, ()
    after = relaxed(surface, rings=rings) if folded else surface
    left = crossing(after)
    if left.any():
        after = relaxed(after, _faulty_near(after, left, most, crossing), rings=rings)
        left = crossing(after)
    shift = np.linalg.norm(after.vertices - surface.vertices, axis=1)
    if shift.max() > most or left.any() or flipped(after).sum() > flips:
        return None
    if not crossed:
        return after, ()
    sentence = (
        f"the moved prior intersects itself: {np.count_nonzero(shift)} vertices were moved, "
        f"up to {shift.max():.2g} {unit}"
    )
    return after, (RunWarning("self-intersection-repaired", sentence),)


def _faulty_near(surface: Surface, crossed: Mask, most: float, crossing: Crossing) -> Crossing:
    """Return what finds flipped faces, and those that cross near the ones that do: only these can come to
    cross while vertices move by less than a length.
    """
    corners = surface.vertices[surface.faces]
    low, high = corners[crossed].min(axis=(0, 1)) - 2.0 * most, corners[crossed].max(axis=(0, 1)) + 2.0 * most
    near = np.flatnonzero(((corners > low) & (corners < high)).all(axis=2).any(axis=1))

    def faulty(moved: Surface) -> Mask:
        found = flipped(moved)
        found[near] |= crossing(replace(moved, faces=moved.faces[near], fields={}))
        return found

    return faulty


@dataclass(frozen=True, eq=False)
class Attempt:
    """An attempt has a level set, the radius (a length) of the closing in it, and what else was done, in
    words.

    Where something was done its band is only as wide as its zero set needs, and it is no distance.
    """

    phi: SignedDistance
    closing: float
    done: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Repair:
    """A repair finds level sets of a topology `kind` (components, Euler number) on a lattice.

    crossing: which faces (m,) of a surface cut through others.
    """

    spacing: float
    kind: tuple[int, int]
    crossing: Crossing
    settings: LatticeSettings
    mesh: Mesher

    def attempts(self, surface: Surface) -> Iterator[Attempt]:
        """Yield level sets of a surface, from no repair to the most: with all that it encloses, since the tip
        of a rim that a fold turned inside out is anatomy, joined to the rest where walls cross; then without
        islands; then without what is inside out; at last with merged walls cut apart.
        """
        lattice = self.settings
        band = cache(
            lambda wall, radius, inverted: self._signed_band(
                wall, radius, lattice.thin_band, inverted=inverted
            )
        )
        few = lattice.closings[: lattice.few_closings]
        yield Attempt(self._signed_band(surface, 0.0, lattice.half_band, inverted=True), 0.0)
        joined = self._join_walls(surface)
        done = () if joined is surface else ("crossing walls were joined",)
        if done:
            yield Attempt(band(joined, 0.0, True), 0.0, done)
        for radius in (self.spacing * closing for closing in few):
            yield Attempt(self.closed(band(joined, radius, True), radius), radius, done)
        for wall, inverted, lost in (
            (joined, True, (*done, "islands were removed")),
            (surface, False, ("islands and inverted parts were removed",)),
        ):
            for radius in (0.0, *(self.spacing * closing for closing in lattice.closings)):
                phi = self.closed(self._keep_whole(band(wall, radius, inverted)), radius)
                yield Attempt(self._keep_whole(phi), radius, lost)
        if self.kind == (1, 2):
            yield Attempt(self._cut_apart(surface), 0.0, ("merged walls were cut apart",))

    def united(self, surface: Surface) -> SignedDistance:
        """Return the level set of a surface, united where it runs into itself."""
        return self._keep_whole(self._signed_band(surface, 0.0, self.settings.half_band, inverted=False))

    def _join_walls(self, surface: Surface) -> Surface:
        """Return a surface that encloses all that this one does and, around its faces that cross, what is
        nearer to them than half a joint: where the walls of a thin part have passed through each other, it is
        thin, and neither of no thickness nor in two.
        """
        crossing = self.crossing(surface)
        if not crossing.any():
            return surface
        radius = self.settings.joint * self.spacing * surface.dimension**0.5
        phi = self._signed_band(surface, radius, self.settings.thin_band, inverted=True)
        around = np.zeros(len(surface.vertices), dtype=bool)
        around[surface.faces[crossing]] = True
        walls = ClosestPoint(surface.vertices, surface.faces[around[surface.faces].any(axis=1)])
        joint = np.sqrt(walls.query(phi.band.positions)[0]) - radius
        return Surface(*self.mesh(replace(phi, phi=np.minimum(phi.phi, joint))))

    def _cut_apart(self, surface: Surface) -> SignedDistance:
        """Return the level set of a surface of one piece without handles: those of merged walls are cut where
        they are thinnest.
        """
        phi = self.united(surface)
        least = self.settings.least_outside * self.spacing
        box = simply_connected(phi.band.dense(phi.phi).astype(np.float64), least)
        return around_zero(box, self.spacing, phi.band.width, phi.band.low)

    def _signed_band(self, surface: Surface, radius: float, half: float, *, inverted: bool) -> SignedDistance:
        """Return the signed distance of a surface, `half` spacings wide, and wider by the radius, so that
        something is left when it grows by that.
        """
        width = radius + half * self.spacing
        return signed_distance(surface.vertices, surface.faces, self.spacing, width, inverted=inverted)

    def _keep_whole(self, phi: SignedDistance) -> SignedDistance:
        """Return the level set of a surface as one component, without the islands that a folded wall
        leaves.
        """
        return phi if self.kind[0] > 1 else replace(phi, phi=without_islands(phi.band, phi.phi))

    def closed(self, phi: SignedDistance, radius: float) -> SignedDistance:
        """Return the level set grown by a radius and shrunk again: tunnels and gaps that a ball of the radius
        does not enter are gone.
        """
        if radius == 0.0:
            return phi
        outer = self.mesh(replace(phi, phi=phi.phi - radius))
        grown = signed_distance(*outer, phi.band.spacing, phi.band.width)
        return replace(grown, phi=grown.phi + radius)


def _warn_of_repair(attempt: Attempt, unit: str) -> tuple[RunWarning, ...]:
    """Warn of how a level set was repaired; nothing was done where there is no warning."""
    done = list(attempt.done)
    if attempt.closing > 0.0:
        done.insert(0, f"gaps narrower than {2.0 * attempt.closing:g} {unit} were closed")
    if not done:
        return ()
    sentence = f"the moved prior intersects itself: {', '.join(done)}"
    return (RunWarning("self-intersection-repaired", sentence),)
