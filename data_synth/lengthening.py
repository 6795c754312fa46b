"""Veins made longer: readers cut them short, and a prior's veins go on where no catheter has been."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from o3dls import InputError, Surface

from . import shapes
from .chamber import ROOT, chamber
from .motion import direction
from .sampling import Mask
from .shapes import Array, Shape
from .solid import meshed, sampled, solid

LONG = 32.0  # mm beyond the body: a vein that reaches so far is left as it is
MORE = (15.0, 25.0)  # mm, from which it is drawn by how much a vein is lengthened
LEAST_MORE = 9.0  # mm: what there is no room for is left short
END = (3.0, 7.0)  # mm from its tip: the ring by which a vein's end is known
BEFORE = (7.0, 13.0)  # and the one before, by which its axis is
WIDTH = (3.0, 9.0)  # mm, the radius of what is added at its root
TAPERED = 0.75  # of that radius at the tip
BENT = 0.35  # by so much of its length the axis leaves the straight line
FILLET = 4.0  # mm
PARTS = 6  # balls along the axis
CLEAR = 3.0  # mm between what is added and any other wall
FREE = 6.0  # mm of the axis that lie in the vein's own wall still
SPACING = 1.5  # mm between vertices of the surface that results
DRAWS = 12  # of a bend, for one that has room


@dataclass(frozen=True, eq=False)
class End:
    """Where a vein ends: the middle (3,) of its last ring, the axis (3,) that leads out, the ring's radius,
    and the walls of all other veins, as points.
    """

    middle: Array
    axis: Array
    radius: float
    others: cKDTree


def lengthened(surface: Surface, seed: int = 7) -> Surface:
    """A closed surface whose short tubes go on by 15 to 25 mm, bent and tapered, with round ends, as a new
    mesh; where there is no room by less or not at all. Raises InputError where the result has other handles.
    """
    rng = np.random.default_rng((seed, 77_291))
    inside = solid(surface)
    added: list[Shape] = []
    reach = [surface.vertices]
    for end in _ends(surface):
        found = _with_room(rng, end, shapes.union(inside, *added))
        if found is not None:
            added.append(shapes.chain(*found))
            reach.append(np.array(found[0]))
    extent = np.vstack([reach[0], *(at + side * WIDTH[1] for at in reach[1:] for side in (-1.0, 1.0))])
    whole = sampled(shapes.union(inside, *added, blend=FILLET), extent, SPACING)
    longer = meshed(whole, extent, SPACING)
    if _euler(longer) != _euler(surface):
        raise InputError(f"seed {seed}: the surface with longer veins has other handles: walls nearly touch")
    return longer


def _ends(surface: Surface) -> list[End]:
    """The ends of short tubes, of each branch its own."""
    parts = chamber(surface, trunk=np.inf)
    tubes = (parts.tube == k for k in range(parts.tubes))
    return [_end(surface, parts.depth, tube) for tube in tubes if parts.depth[tube].max() < LONG]


def _end(surface: Surface, depth: Array, tube: Mask) -> End:
    top = float(depth[tube].max())
    last, before = (
        surface.vertices[tube & (depth >= top - far) & (depth <= top - near)] for near, far in (END, BEFORE)
    )
    axis = last.mean(axis=0) - (before if len(before) > 2 else surface.vertices).mean(axis=0)
    axis /= np.linalg.norm(axis)
    others = cKDTree(surface.vertices[(depth > ROOT) & ~tube])
    arm = last - last.mean(axis=0)
    radius = np.linalg.norm(arm - (arm @ axis)[:, None] * axis, axis=1)
    return End(last.mean(axis=0), axis, float(np.clip(np.median(radius), *WIDTH)), others)


def _with_room(rng: np.random.Generator, end: End, walls: Shape) -> tuple[list[Array], list[float]] | None:
    """Balls along a bent axis that stay clear of other walls: their middles and radii; None where no bend
    that was drawn leaves room for 9 mm.
    """
    wanted = float(rng.uniform(*MORE))
    for share in (1.0, 0.8, 0.6):
        for _ in range(DRAWS if share * wanted >= LEAST_MORE else 0):
            balls = _balls(end, share * wanted + END[1], BENT * direction(rng))
            if _is_clear(end, balls, walls):
                return balls
    return None


def _balls(end: End, length: float, bend: Array) -> tuple[list[Array], list[float]]:
    """Middles and radii along an arc that begins along the axis."""
    share = np.linspace(0.0, 1.0, PARTS + 1)
    side = bend - (bend @ end.axis) * end.axis
    middles = end.middle + length * (share[:, None] * end.axis + (share**2)[:, None] * side)
    return list(middles), list(end.radius * (1.0 + (TAPERED - 1.0) * share))


def _is_clear(end: End, balls: tuple[list[Array], list[float]], walls: Shape) -> bool:
    """Whether no ball comes near another vein, and none beyond the vein's own end near any wall."""
    middles, radii = np.array(balls[0]), np.array(balls[1])
    beyond = np.linalg.norm(middles - end.middle, axis=1) > END[1] + FREE
    free = walls(middles)[beyond] > radii[beyond] + CLEAR
    return bool(free.all() and (end.others.query(middles)[0] > radii + CLEAR).all())


def _euler(surface: Surface) -> int:
    return len(surface.vertices) - len(surface.faces) // 2
