"""Checks of the stage `level_set`: that the grid can hold the surface, and that the mesh stands for it."""

from __future__ import annotations

from ..errors import InputError, SolverError
from ..geometry.surface import Surface
from ..run_warning import RunWarning

COARSEST = 0.1  # spacing over the surface's diagonal: such a grid cuts off a fifth of an atrium
MOST_NODES = 1e7  # of the narrow band: 4 GB; an atrium has so many at a spacing of 0.07 mm
SCALED = 2.0  # how much larger or smaller than the prior what is moved may be
LOST = 2.0  # spacings: a sharp edge that the grid rounds off is nearer to what it leaves
NOTHING = 8.0  # grid cells: less is no surface
UNLIKE = 0.25  # relative difference in volume from what was to be meshed that accuracy does not explain


def check_spacing(spacing: float, surface: Surface, unit: str) -> None:
    """Raise InputError where there is a mistake in the spacing for the surface."""
    if why := spacing_mistake(spacing, surface, unit):
        raise InputError(f"level_set.{why}")


def spacing_mistake(spacing: float, surface: Surface, unit: str, times: float = 1.0) -> str | None:
    """Say why a grid cannot hold the surface, as when lengths are not in mm, or would fill the memory; None
    where it can. The surface may still become so many times larger or smaller.
    """
    from ..levelset.settings import LatticeSettings

    d, size = surface.dimension, surface.diagonal
    # two digits round by up to a twentieth: the spacing that the sentence suggests must not be refused
    given = f"spacing = {spacing:g} {unit}: the surface is {size:.3g} {unit} across"
    if spacing > COARSEST * size * times:
        most = f"{0.94 * COARSEST * size:.2g} {unit}"
        return f"{given}; take at most {most}, or check that its lengths are in {unit}"
    least = (2.0 * LatticeSettings().half_band * surface.area / MOST_NODES) ** (1.0 / (d - 1))
    if spacing < least / times:
        enough = f"{1.06 * least:.2g} {unit}"
        return f"{given}, and the grid too large for the memory; take at least {enough}"
    return None


def check_mesh(mesh: Surface, wall: Surface, spacing: float, keep: float, unit: str) -> None:
    """Raise SolverError where the mesh encloses far more or less than the wall that it stands for."""
    change = mesh.volume / wall.volume - 1.0
    if mesh.volume < NOTHING * spacing**wall.dimension:
        raise SolverError(
            "level_set: the surface shrank to nothing: the start or the scale may be wrong, or the points "
            "may belong to another surface"
        )
    if abs(change) > UNLIKE:
        raise SolverError(
            f"level_set: the mesh encloses {abs(change):.0%} {'more' if change > 0.0 else 'less'} than the "
            f"surface it stands for: unless that is folded, a spacing below {spacing:g} {unit} or keep above "
            f"{keep:g} may help"
        )


def lost_parts(mesh: Surface, wall: Surface, spacing: float, unit: str) -> list[RunWarning]:
    """Warn of parts of the wall, however little they enclose, that are not in the mesh."""
    from ..topology.wall import Wall

    far = float(Wall(mesh).look(wall.vertices)[0].max())
    if far < LOST * spacing:
        return []
    sentence = (
        f"parts of the moved prior, up to {far:.2g} {unit} from the mesh, are lost: they are thinner than "
        "the grid can hold, or were cut off where the prior intersects itself; a smaller spacing may help"
    )
    return [RunWarning("parts-lost", sentence)]
