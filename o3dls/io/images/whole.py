"""Whether the piece that is taken of a label is the chamber: how much of the label it holds, and what else it
may be.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Mask
from ...errors import Answer, Doubt, InputError

LEAST = 0.8  # share of a label that its largest piece must hold: the rest of a chamber is crumbs
OVERLAP = 0.5  # share of the smaller section that the next one covers, of one body across blank slices
OUTLINE = 2.0  # times as many voxels lie within an outline as on it, at least
AROUND = 0.5  # share of the outermost voxels of a volume that no chamber covers
FEWEST_IN_SPACE = 4  # voxels along an axis: fewer hold no chamber, but channels
MOST_CHANNELS = 8


def blank_slices(mask: Mask) -> tuple[int, list[tuple[int, int]]]:
    """Return the axis along which most slices of a mask are blank, and each gap of blank ones by the slices
    before and behind it. Their sections overlap: what lies apart in the plane too is another body.
    """
    found = [_gaps(np.moveaxis(mask, axis, 0)) for axis in range(3)]
    axis = int(np.argmax([count_blank(gaps) for gaps in found]))
    return axis, found[axis]


def _gaps(mask: Mask) -> list[tuple[int, int]]:
    there = np.flatnonzero(mask.any(axis=(1, 2))).tolist()
    return [
        (low, high)
        for low, high in pairwise(there)
        if high - low > 1
        and (mask[low] & mask[high]).sum() > OVERLAP * min(mask[low].sum(), mask[high].sum())
    ]


def count_blank(gaps: list[tuple[int, int]]) -> int:
    return sum(high - low - 1 for low, high in gaps)


def slices_filled(mask: Mask, spacing: Array) -> Mask:
    """Return a mask whose blank slices are interpolated by shape: signed distances in the plane (Raya and
    Udupa 1990), between the next slices that are not blank. spacing (3,): along the axes of the mask.
    """
    axis, gaps = blank_slices(mask)
    filled = np.moveaxis(mask.copy(), axis, 0)
    for low, high in gaps:
        before, behind = (_signed(filled[end], np.delete(spacing, axis)) for end in (low, high))
        for k in range(low + 1, high):
            t = (k - low) / (high - low)
            filled[k] = (1.0 - t) * before + t * behind < 0.0
    return np.moveaxis(filled, 0, axis)


def _signed(section: Mask, widths: Array) -> Array:
    """Return the distance to the other side of a section (rows, columns), negative inside."""
    from scipy.ndimage import distance_transform_edt

    outside, inside = (distance_transform_edt(part, sampling=widths) for part in (~section, section))
    return np.asarray(outside - inside)


def check_layout(shape: tuple[int, ...], where: str) -> None:
    """Raise InputError where an axis of space (nz, ny, nx, layers) is as short as channels are, and the one
    of layers is as long as space.
    """
    if len(shape) == 4 and min(shape[:3]) <= FEWEST_IN_SPACE and shape[3] > MOST_CHANNELS:
        axes = " x ".join(map(str, (*shape[2::-1], shape[3])))
        raise InputError(
            f"{where}: has {axes} voxels: an axis of space is as short as channels are, and the last one is "
            "as long as space; save the array with x, y, z first, as by numpy.moveaxis(array, 0, -1)"
        )


def share_of_border(values: NDArray[Any], label: int) -> float:
    """Return the share of the outermost voxels of a volume that a label covers: no chamber has half."""
    sides = [values.take(end, axis) == label for axis in range(3) for end in (0, -1)]
    return float(sum(side.sum() for side in sides) / sum(side.size for side in sides))


def check_taken(mask: Mask, taken: Mask, affine: Array, where: str) -> None:
    """Raise InputError where the piece that is taken of a mask is much less than the whole, with the reason,
    and what to do. `affine` takes an index, last axis first, to mm.
    """
    total = int(mask.sum())
    share = int(taken.sum()) / total
    if share >= LEAST:
        return
    part = f"{where}: its largest piece holds {share:.0%} of its {total} voxels (at least {LEAST:.0%})"
    blank = count_blank(blank_slices(mask)[1])
    inside = _voxels_within(mask)
    if inside > OUTLINE * total:
        raise InputError(
            f"{part}: it is an outline, within which {inside - total} more voxels lie; fill it first, as in "
            "3D Slicer"
        )
    if blank:
        raise Doubt(
            f"{part}: blank slices lie within it, {blank} of them",
            "say --fill-slices, which interpolates them, or export it again with all its slices",
            [Answer("interpolate the blank slices", {"fill_slices": True})],
        )
    raise InputError(f"{part}: {_separate_pieces(mask, taken, affine)}")


def _voxels_within(mask: Mask) -> int:
    """Return how many voxels lie on and within a mask, slice by slice, along the axis that gives most."""
    from scipy.ndimage import binary_fill_holes

    used = tuple(slice(axis.min(), axis.max() + 1) for axis in np.nonzero(mask))
    cut = mask[used]
    return max(
        sum(int(binary_fill_holes(section).sum()) for section in np.moveaxis(cut, axis, 0))
        for axis in range(3)
    )


def _separate_pieces(mask: Mask, taken: Mask, affine: Array) -> str:
    """Return what to do with a label of several pieces: cut to the largest, where a box has it alone."""
    at = np.argwhere(taken)[:, ::-1] @ affine[:3, :3].T + affine[:3, 3]
    half = np.abs(affine[:3, :3]).sum(axis=1) / 2
    low, high = np.floor(at.min(axis=0) - half), np.ceil(at.max(axis=0) + half)
    every = np.argwhere(mask)[:, ::-1] @ affine[:3, :3].T + affine[:3, 3]
    inside = ((every >= low) & (every <= high)).all(axis=1).sum()
    if len(at) < LEAST * inside:
        return "the others lie around it; join them, or save the chamber as a label of its own"
    box = " ".join(f"{value:g}" for value in (*low, *high))
    return f"where it is the chamber alone, cut to it with --box {box}, else join the pieces first"
