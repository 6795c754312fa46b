"""The reconstruction as a result: its level set, its fields, what is said of it."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..geometry.components import components_and_euler
from ..geometry.surface import Surface, interpolated
from ..levelset.grid.distance import signed_distance
from ..levelset.repair import Mesher
from ..levelset.result import Result
from ..levelset.settings import LatticeSettings
from ..run_warning import RunWarning
from .field.deviation import deviation
from .field.reconstruction import Reconstruction
from .points.believed import Believed
from .reconstruct import reconstruct
from .settings import ReconstructionSettings
from .shape.pieces import reconstructed_wall

DEFAULTS = ReconstructionSettings()


def reconstructed(
    surface: Surface,
    believed: Believed,
    unit: str,
    spacing: float,
    mesh: Mesher,
    settings: ReconstructionSettings = DEFAULTS,
) -> Result | None:
    """Return the moved prior reconstructed from points; None where these predict each other no better than it
    does, or it is no single piece. Of handles only those stay or come that points show.

    unit: of lengths, in the names of fields; spacing: of the lattice of phi; mesh: what will mesh phi. The
    fields of the wall are the deviation of the reconstruction (`sd`), where the motion leaves one in the same
    field of the surface, and `correction`, how far it lies outside the surface.
    """
    pieces, euler = components_and_euler(surface.vertices, surface.faces)
    if pieces != 1:
        return None
    found = reconstruct(surface, believed, spacing, settings)
    if found is None:
        return None
    wall, removed, filled = reconstructed_wall(found, settings, mesh)
    changes = _handles_changed(euler, components_and_euler(wall.vertices, wall.faces)[1])
    width = LatticeSettings().half_band * spacing
    phi = signed_distance(wall.vertices, wall.faces, spacing, width)
    return Result(
        phi=phi,
        wall=wall,
        sigma=found.sigma,
        status=_describe_wall(found, removed, settings),
        converged=True,
        warnings=_warn_of_removed(removed, template=found.template)
        + _warn_of_filled(filled)
        + _warn_of_changes(changes),
        facts={
            "evidence_nats": found.gain,
            "amplitude": float(np.median(found.wall.amplitude)),
            "band_nodes": len(phi.band),
            "removed_parts": removed,
            "filled_pockets": filled,
            "changes": changes,
        },
        weights=found.weights,
        fields=lambda places: _wall_fields(places, unit, found, believed.doubt, settings),
        exact=True,
    )


def _wall_fields(
    places: Array, unit: str, found: Reconstruction, doubt: float, settings: ReconstructionSettings
) -> dict[str, Array]:
    """Return the wall's deviation (n,) at places (n, 3), and how far these lie outside the moved prior; no
    point lessens the doubt, since it is of what points share.
    """
    surface, sd = found.prior.surface, f"sd_{unit}"
    squared, face, _, weights = found.prior.tree.query(places)
    side = np.where(found.prior.at(places) < 0.0, -1.0, 1.0)
    fields = {f"correction_{unit}": side * np.sqrt(squared)}
    if sd in surface.fields:
        before = interpolated(surface.fields[sd], surface.faces[face], weights)
        independent = np.sqrt(np.maximum(before**2 - doubt**2, 0.0))
        fields[sd] = np.hypot(deviation(places, independent, found, settings), doubt)
    return fields


def _describe_wall(found: Reconstruction, removed: int, settings: ReconstructionSettings) -> str:
    why = "it predicts left-out points better than the moved prior does"
    if found.template and removed and found.gain < settings.evidence:
        why = "parts of the template are absent from the map"
    return (
        f"the wall was reconstructed from {len(found.wall.feet)} points, and from the moved prior where "
        f"there are none: {why} (evidence {found.gain:+.0f} nats)"
    )


def _warn_of_removed(parts: int, *, template: bool) -> tuple[RunWarning, ...]:
    """Warn that parts were removed, if any were."""
    if not parts:
        return ()
    were = "1 part of the prior was" if parts == 1 else f"{parts} parts of the prior were"
    why = "the points are likelier without, as where they close the mouth of a part"
    if template:
        why = "hardly a point lies there, though points close the mouth or lie on nearly all other wall"
    return (RunWarning("topology-changed", f"{were} removed ({why}): check it in the report"),)


def _warn_of_filled(pockets: int) -> tuple[RunWarning, ...]:
    """Warn that pockets of the outside were filled, if any were."""
    if not pockets:
        return ()
    were = "1 pocket of the outside was" if pockets == 1 else f"{pockets} pockets of the outside were"
    why = "hardly a point lies there, though points close the mouth"
    return (RunWarning("topology-changed", f"{were} filled ({why}): check it in the report"),)


def _handles_changed(before: int, after: int) -> list[str]:
    """Say what became of the handles of the prior, of one Euler number, in a wall of another; nothing if none
    changed.
    """
    more = (before - after) // 2  # a handle takes two from the Euler number
    if more == 0:
        return []
    were = "1 handle was" if abs(more) == 1 else f"{abs(more)} handles were"
    if more > 0:
        return [f"{were} made that the prior lacks: points are likelier with than without"]
    return [f"{were} cut that the prior has: points do not show more than are left"]


def _warn_of_changes(changes: list[str]) -> tuple[RunWarning, ...]:
    return tuple(RunWarning("topology-changed", f"{change}; check it in the report") for change in changes)
