"""A proposed change of topology, and the surface after it."""

from __future__ import annotations

from dataclasses import dataclass

from ..arrays import Array, Ints
from ..geometry.components import largest_component
from ..geometry.differential import evened
from ..geometry.surface import Surface
from ..levelset.grid.distance import SignedDistance, signed_distance
from ..levelset.grid.isosurface import zero_set
from ..levelset.grid.operators import combine
from ..levelset.grid.regularised import regularised


@dataclass(frozen=True, eq=False)
class Change:
    """A change is proposed with the closed surface of the region that it removes or adds, log evidence
    `gain`, less the price (nats) of what is rare beforehand, how many points are `witnesses`, and the
    `centre` (d,) to look at, in the map frame. The price is `rarity`, and `gathers` for each point of a map:
    new wall should have its share of them.
    """

    removes: bool
    region: tuple[Array, Ints]
    gain: float
    rarity: float
    gathers: float
    witnesses: int
    odd: Array  # the points (k, d) that ask for it: deep inside about a part, or far outside
    centre: Array

    def price(self, points: int) -> float:
        """Return the nats that the change costs in a map of so many points."""
        return self.rarity + self.gathers * points

    def sentence(self, unit: str) -> str:
        done = "removed a part" if self.removes else "added a tube"
        where = ", ".join(f"{x:.0f}" for x in self.centre)
        support = f"supported by {self.witnesses} points (evidence {self.gain:+.1f} nats)"
        return f"{done} at ({where}) {unit}, {support}"


def changed(before: SignedDistance, change: Change | None) -> Surface:
    """Return the surface of a level set after a change (None: as it is): one component, without fields."""
    band, phi = before.band, before.phi
    if change is not None:
        region = signed_distance(*change.region, band.spacing, band.width)
        band, phi = combine(before, region, remove=change.removes)
    vertices, faces = largest_component(*zero_set(band, phi))
    if band.dimension == 2:
        return Surface(evened(vertices, faces), faces)
    return regularised(Surface(vertices, faces), band.spacing)


def body_radius(surface: Surface, least_compact: float = 0.25) -> float:
    """Return d * volume / area: the radius of a ball, the half width of a thick body. It is at least that of
    the least compact body, since roughness multiplies an area. least_compact: radius over the d-th root of
    the volume, .31 to .49 for atria with veins, .62 for a ball.
    """
    least = least_compact * float(surface.volume ** (1.0 / surface.dimension))
    return max(surface.dimension * surface.volume / surface.area, least)
