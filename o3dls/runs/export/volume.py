"""The volume that a surface encloses as an image: its signed distance, its inside, or its chamber and wall on
the grid of another image.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...adapters.voxels import spacing_mistake, voxelise
from ...errors import InputError
from ...geometry.similarity import TURN, apply
from ...geometry.surface import Surface

CHAMBER, MAPPED, PRIOR_ONLY = 1, 2, 3  # labels on the grid of an image


def write_enclosed_volume(
    path: Path, surface: Surface, spacing: float, space: str, *, distance: bool
) -> dict[str, Any]:
    """Write the signed distance of a surface or, without `distance`, its inside as 0 and 1.

    The distance is in mm, negative inside, and cut at four voxels outside. Gives facts for the sidecar.
    """
    from ...io.images.volumes import write_volume

    if why := spacing_mistake(surface, spacing):
        raise InputError(f"export: {why}")
    found = voxelise(surface, spacing, margin=4)
    write_volume(path, found.phi if distance else found.inside, found.affine, space=space)
    meaning = "signed distance, negative inside" if distance else "1 inside, 0 outside"
    return {"spacing": spacing, "values": meaning}


def write_labels_like(path: Path, surface: Surface, grid: Path, space: str) -> dict[str, Any]:
    """Write what a surface encloses as labels on the voxels of another image: the chamber, and its outermost
    voxels apart by whether a point is near. Gives facts for the sidecar.

    Raises InputError where the image is none, or does not hold the surface.
    """
    from ...io.images.registry import knows, read_image
    from ...io.images.volumes import write_volume
    from ...io.text import read_bytes

    data = read_bytes(grid)
    if not knows(data):
        raise InputError(
            f"{grid}: is not an image whose grid could be taken: must be NRRD, NIfTI or MetaImage"
        )
    image = read_image(grid, data)
    turn = TURN if {space, image.space} == {"LPS", "RAS"} else np.eye(4)
    affine = turn @ image.affine
    shape = image.values.shape[2::-1]
    labels = _label_voxels(surface, affine, shape)
    if not labels.any():
        raise InputError(
            f"{grid}: the surface lies outside its {shape} voxels: is it the image of this prior?"
        )
    write_volume(path, labels, affine, space=space)
    return {
        "grid": list(shape),
        "values": {
            "0": "outside",
            str(CHAMBER): "chamber",
            str(MAPPED): "its outermost voxels where a point is near",
            str(PRIOR_ONLY): "its outermost voxels known from the prior alone",
        },
    }


def _label_voxels(surface: Surface, affine: NDArray[Any], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return labels (nx, ny, nz) of the voxels whose centres (i, j, k) `affine` takes to the surface's
    frame.
    """
    from scipy.ndimage import binary_erosion
    from scipy.spatial import cKDTree

    from ...levelset.grid.winding import winding

    labels = np.zeros(shape, dtype=np.uint8)
    local = apply(np.linalg.inv(affine), surface.vertices)
    low = np.maximum(np.floor(local.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(local.max(axis=0)).astype(int) + 2, shape)
    if (high <= low).any():
        return labels
    box = high - low
    nodes = np.ascontiguousarray(np.indices(tuple(box)).reshape(3, -1).T, dtype=np.int32)
    number, _ = winding(nodes, local - low, surface.faces, box)
    inside = (number != 0).reshape(box)
    wall = inside & ~binary_erosion(inside, border_value=1)
    alone = surface.fields.get("prior_only", np.zeros(len(surface.vertices)))
    at = apply(affine, np.argwhere(wall) + low)
    nearest = cKDTree(surface.vertices).query(at)[1] if len(at) else np.zeros(0, dtype=int)
    part = np.where(inside, CHAMBER, 0).astype(np.uint8)
    part[wall] = np.where(alone[nearest] == 0.0, MAPPED, PRIOR_ONLY)
    labels[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = part
    return labels
