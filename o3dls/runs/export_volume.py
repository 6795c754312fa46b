"""The volume that a surface encloses as an image: its signed distance, or its inside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.surface import Surface

FEWEST_ACROSS, MOST_VOXELS = 10.0, 1e8  # of a volume, over the diagonal and in all


def write_enclosed_volume(
    path: Path, surface: Surface, spacing: float, space: str, *, distance: bool
) -> dict[str, Any]:
    """Write the signed distance of a surface or, without `distance`, its inside as 0 and 1.

    The distance is in mm, negative inside, and cut at four voxels outside. Gives facts for the sidecar.
    """
    from ..io.images.volumes import write_volume
    from ..levelset.grid.distance import filled_distance

    if why := spacing_mistake(surface, spacing):
        raise InputError(f"export: {why}")
    steps = 4
    outside = steps * spacing
    found = filled_distance(surface.vertices, surface.faces, spacing, steps)
    phi = np.full(found.band.shape, outside)
    phi[tuple(found.band.nodes.T)] = np.minimum(found.phi, outside)
    write_volume(
        path,
        phi if distance else phi < 0.0,
        spacing,
        found.band.origin,
        space=space,
    )
    meaning = "signed distance, negative inside" if distance else "1 inside, 0 outside"
    return {"spacing": spacing, "values": meaning}


def spacing_mistake(surface: Surface, spacing: float) -> str | None:
    """Why the spacing of a volume is too coarse or too fine for a surface."""
    voxels = float(np.prod(np.ptp(surface.vertices, axis=0) / spacing))
    if spacing <= surface.diagonal / FEWEST_ACROSS and voxels <= MOST_VOXELS:
        return None
    finest = spacing * (voxels / MOST_VOXELS) ** (1 / 3)
    coarsest = surface.diagonal / FEWEST_ACROSS
    between = f"a spacing between {finest:.2g} and {coarsest:.2g} would be right"
    return f"spacing = {spacing:g}: a volume of {voxels:.2g} voxels; {between}"
