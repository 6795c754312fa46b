"""Label volumes of SimpleITK (LPS) and nibabel (RAS) in memory, as the readers of files give them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..errors import InputError
from ..io.images.nifti import place, stated_units
from ..io.images.voxels import Image, check_affine


def _from_simpleitk(image: Any, where: str, frame: str | None, form: str | None) -> Image:
    """Return an image of SimpleITK: ITK's space is LPS, and its arrays are (nz, ny, nx), with components
    behind and time in front.
    """
    from SimpleITK import GetArrayFromImage

    if form is not None:
        raise InputError(f"{where}: 'form' does not apply to it: only NIfTI has a sform and a qform")
    n = image.GetDimension()
    layers = image.GetNumberOfComponentsPerPixel()
    if n not in (3, 4) or (n == 4 and layers > 1):
        raise InputError(
            f"{where}: is an image of {n} axes and {layers} components: must be a volume "
            "in 3D, or layers of one"
        )
    affine = np.eye(4)
    affine[:3, :3] = np.reshape(image.GetDirection(), (n, n))[:3, :3] * image.GetSpacing()[:3]
    affine[:3, 3] = image.GetOrigin()[:3]
    values = GetArrayFromImage(image)
    notes = {key: image.GetMetaData(key) for key in image.GetMetaDataKeys()}
    return Image(np.moveaxis(values, 0, -1) if n == 4 else values, check_affine(where, affine), "LPS", notes)


def _from_nibabel(image: Any, where: str, frame: str | None, form: str | None) -> Image:
    """Return an image of nibabel as the reader of NIfTI files does: the header says how it lies."""
    values = np.asanyarray(image.dataobj)
    layers = [n for n in values.shape[3:] if n != 1]
    if values.ndim < 3 or len(layers) > 1:
        raise InputError(
            f"{where}: has axes of {values.shape}: must be one volume in 3D, or several along one axis"
        )
    values = values.reshape(*values.shape[:3], *layers)
    return Image(
        np.swapaxes(values, 0, 2), *place(image.header, where, frame, form), stated_units(image.header)
    )


IMAGES: Mapping[str, Callable[[Any, str, str | None, str | None], Image]] = {
    "SimpleITK.Image": _from_simpleitk,
    "nibabel.Nifti1Pair": _from_nibabel,
}
