"""Image volumes of any format, told by content. Own readers, since ITK crashes on damaged files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import InputError
from . import metaimage, nifti, nrrd
from .voxels import Image

LONGEST_VOXEL = 20.0  # times its width


def knows(data: bytes) -> bool:
    return nrrd.knows(data) or metaimage.knows(data) or nifti.knows(data)


def read_image(path: Path, data: bytes) -> Image:
    """The volume in a file. Raises InputError where it is damaged or does not say how it lies in space."""
    read = (
        nrrd.read_nrrd
        if nrrd.knows(data)
        else metaimage.read_meta
        if metaimage.knows(data)
        else nifti.read_nifti
    )
    image = read(path, data)
    affine = image.affine
    if abs(np.linalg.det(affine)) < 1e-9:
        raise InputError(f"{path}: its axes span no volume: {affine[:3].round(6).tolist()}")
    if image.spacing.max() > LONGEST_VOXEL * image.spacing.min():
        raise InputError(
            f"{path}: its voxels measure {image.spacing.round(4).tolist()} mm: must not be "
            f"{LONGEST_VOXEL:g} times longer than wide"
        )
    return image
