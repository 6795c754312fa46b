"""The reconstruction as a refinement of the moved prior: its level set, its fields, what is said of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...geometry.components import components_and_euler
from ...geometry.surface import Surface, interpolated
from ...run_warning import RunWarning
from ..correction import Limits
from ..grid.distance import signed_distance
from ..refine import Refinement
from .deviation import deviation
from .reconstruct import Believed, Reconstruction, reconstruct
from .settings import ReconstructionSettings
from .wall import reconstructed_wall

SIMPLE = 2  # Euler number of a piece without handles: a reconstruction has no other


def reconstructed(surface: Surface, believed: Believed, sd: str, limits: Limits) -> Refinement | None:
    """The moved prior reconstructed from points; None where these predict each other no better than it does,
    or it is no single piece. Handles of the prior are cut.

    sd: name of the field of the surface that holds the deviation which the motion leaves. The wall has the
    surface's fields at its closest points, the deviation of the reconstruction, and `correction`, how far it
    lies outside the surface.
    """
    pieces, euler = components_and_euler(surface.vertices, surface.faces)
    if pieces != 1:
        return None
    settings = limits.settings.reconstruction
    found = reconstruct(surface, believed, limits.spacing, settings)
    if found is None:
        return None
    wall, removed, filled = reconstructed_wall(found, settings)
    squared, face, _, weights = found.prior.tree.query(wall.vertices)
    side = np.where(found.prior.at(wall.vertices) < 0.0, -1.0, 1.0)
    corners = surface.faces[face]
    before = (
        interpolated(surface.fields[sd], corners, weights) if sd in surface.fields else np.zeros(len(face))
    )
    fields = {
        sd: deviation(wall.vertices, before, found, settings),
        "correction": side * np.sqrt(squared),
    }
    wall = replace(wall, fields=fields)
    width = limits.settings.lattice.half_band * limits.spacing
    phi = signed_distance(wall.vertices, wall.faces, limits.spacing, width)
    return Refinement(
        phi=phi,
        wall=wall,
        sigma=found.sigma,
        status=_sentence(found, removed, settings),
        converged=True,
        warnings=_removed(removed) + _filled(filled) + _cut(euler),
        facts={
            "evidence_nats": found.gain,
            "amplitude": float(np.median(found.wall.amplitude)),
            "band_nodes": len(phi.band),
            "removed_parts": removed,
            "filled_pockets": filled,
        },
        weights=found.weights,
        exact=True,
    )


def _sentence(found: Reconstruction, removed: int, settings: ReconstructionSettings) -> str:
    why = "it predicts left-out points better than the moved prior does"
    if found.gradient > settings.surplus.own and removed and found.gain < settings.evidence:
        why = "parts of the prior, which bends as into another heart, are absent from the map"
    return (
        f"the wall was reconstructed from {len(found.wall.feet)} points, and from the moved prior where "
        f"there are none: {why} (evidence {found.gain:+.0f} nats)"
    )


def _removed(parts: int) -> tuple[RunWarning, ...]:
    """A warning where parts were removed."""
    if not parts:
        return ()
    were = "1 part of the prior was" if parts == 1 else f"{parts} parts of the prior were"
    why = "hardly a point lies there, though points close the mouth or lie on nearly all other wall"
    return (RunWarning("topology-changed", f"{were} removed ({why}): check it in the report"),)


def _filled(pockets: int) -> tuple[RunWarning, ...]:
    """A warning where pockets of the outside were filled."""
    if not pockets:
        return ()
    were = "1 pocket of the outside was" if pockets == 1 else f"{pockets} pockets of the outside were"
    why = "hardly a point lies there, though points close the mouth"
    return (RunWarning("topology-changed", f"{were} filled ({why}): check it in the report"),)


def _cut(euler: int) -> tuple[RunWarning, ...]:
    """A warning where the prior had handles."""
    if euler >= SIMPLE:
        return ()
    were = "a handle of the prior was" if euler == SIMPLE - 2 else "handles of the prior were"
    return (RunWarning("topology-changed", f"{were} cut: a reconstruction has none; check it in the report"),)
