"""From an angiogram to a prior: threshold, parts that do not belong removed, surface of the label map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..errors import InputError
from ..geometry.surface import Surface
from ..io.images.wall import mask_surface

NECK = 3.0  # mm: a part joined to the chamber by a neck narrower than twice this is cut off


def segmented(scan: NDArray[np.float32], affine: Array, inside: Array) -> tuple[Surface, NDArray[np.bool_]]:
    """Segment the chamber that holds the place `inside` (mm), and return its surface and label map; scan (nz,
    ny, nx), affine of indices (x, y, z).
    """
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(scan, 0.6)
    spacing = np.abs(np.diag(affine)[:3])
    mask = without_neighbours(
        smooth > threshold(smooth),
        spacing[::-1],
        np.round((inside - affine[:3, 3]) / spacing)[::-1].astype(int),
    )
    return mask_surface(mask, affine), mask


def threshold(values: NDArray[np.float32], bins: int = 256) -> float:
    """Return the grey value that best parts values in two classes (Otsu 1979)."""
    count, edge = np.histogram(values, bins)
    centre = (edge[:-1] + edge[1:]) / 2.0
    below = np.cumsum(count)[:-1]
    above = count.sum() - below
    total = np.cumsum(count * centre)
    between = below * above * (total[:-1] / below - (total[-1] - total[:-1]) / above) ** 2
    return float(edge[np.argmax(between) + 1])


def without_neighbours(mask: NDArray[np.bool_], spacing: Array, seed: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the part of a mask about a voxel: the mask shrunk until necks break, the piece of the voxel
    kept, and grown back.
    """
    from scipy.ndimage import distance_transform_edt, label

    core, _ = label(distance_transform_edt(mask, sampling=spacing) > NECK)
    if core[tuple(seed)] == 0:
        raise InputError(
            f"segmentation: voxel {seed.tolist()} (z, y, x) is not inside a chamber of the angiogram"
        )
    near = distance_transform_edt(core != core[tuple(seed)], sampling=spacing) <= NECK + spacing.max()
    pieces, _ = label(mask & near)
    return np.asarray(pieces == pieces[tuple(seed)])
