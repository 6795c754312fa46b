"""Image volumes of any format, told by content; docs/files.md says what reads each, and why."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import InputError
from . import dicom, metaimage, nifti, nrrd
from .sidecar import agreed
from .voxels import Image

LONGEST_VOXEL = 20.0  # how many times longer than wide a voxel may be


def knows(data: bytes) -> bool:
    return dicom.knows(data) or nrrd.knows(data) or metaimage.knows(data) or nifti.knows(data)


def read_image(
    path: Path,
    data: bytes,
    frame: str | None = None,
    form: str | None = None,
    sidecar: str | None = None,
) -> Image:
    """Read the volume in a file; `frame` is that of its axes where the file does not say how they lie, `form`
    the one that is right of a NIfTI whose sform and qform contradict, `sidecar` what is done with a JSON file
    beside it that contradicts it: ignore or take. Raises InputError where it is damaged or does not lie
    anywhere.
    """
    if form is not None and (dicom.knows(data) or not nifti.knows(data)):
        raise InputError(f"{path}: 'form' does not apply to it: only NIfTI has a sform and a qform")
    if dicom.knows(data):
        image = dicom.read_dicom(path, data)
    elif nrrd.knows(data):
        image = nrrd.read_nrrd(path, data, frame)
    elif metaimage.knows(data):
        image = metaimage.read_meta(path, data)
    else:
        image = nifti.read_nifti(path, data, frame, form)
    return checked(agreed(path, image, sidecar), str(path))


def checked(image: Image, where: str) -> Image:
    """Return the image unchanged. Raises InputError where its voxels are of no size that a scanner has."""
    affine = image.affine
    if abs(np.linalg.det(affine)) <= 1e-9 * image.spacing.prod():
        raise InputError(f"{where}: its axes span no volume: {affine[:3].round(6).tolist()}")
    if image.spacing.max() > LONGEST_VOXEL * image.spacing.min():
        raise InputError(
            f"{where}: its voxels measure {image.spacing.round(4).tolist()} mm: must not be "
            f"{LONGEST_VOXEL:g} times longer than wide"
        )
    return image
