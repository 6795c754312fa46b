"""The chamber among the pieces of a label: the largest, and thin ones that only the gap between two slices
parts from it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Mask

THIN = 0.6  # voxels, deviation of a blur: a mask that it wipes out encloses nothing
THICK = 3.0  # widths of a voxel: between thinner slices no vein is lost that shows in them
WIDEST = 1.0  # slice distances, radius: the sections of what is wider overlap, so it is another chamber
FARTHEST = 0.7  # slice distances, from section to section: 5 mm wide at 66 degrees through 8 mm
THINNEST = 1.5  # voxels, radius: less is dust


class Bridge(NamedTuple):
    """A bridge leads from the section of a piece in slice `start` to that of the chamber in slice `end`
    beside it; both are masks (rows, columns).
    """

    start: int
    end: int
    piece: Mask
    chamber: Mask


def largest(mask: Mask) -> Mask:
    """Return the largest piece, connected over faces."""
    from scipy.ndimage import label

    pieces, _ = label(mask)
    sizes = np.bincount(pieces.ravel())
    return np.asarray(pieces == 1 + sizes[1:].argmax())


def thick(spacing: Array) -> bool:
    """Return whether slices are so thick that a vein may be lost between them; spacing (3,) with theirs
    first.
    """
    return bool(spacing[0] >= THICK * spacing[1:].max())


def wide(mask: Mask) -> Mask:
    """Return where a mask is wide enough to enclose anything: three voxels in a plane are, a line is not."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(mask.astype(np.float32), THIN) > 0.5)


def filled(mask: Mask) -> Mask:
    """Return a mask with outside all around, without the holes inside it that are too thin to enclose
    anything.
    """
    from scipy.ndimage import label

    outside, _ = label(~mask)
    holes = (outside > 0) & (outside != outside[0, 0, 0])
    return np.asarray(mask | (holes & ~np.isin(outside, outside[wide(holes) & holes])))


def joined(mask: Mask, spacing: Array) -> tuple[Mask, list[Bridge]]:
    """Return the largest piece of a mask (slices, rows, columns) with the thin ones that go on from it, and
    the bridges to these.

    The sections of a tube that is thinner than its slices need not overlap where it runs obliquely.
    """
    from scipy.ndimage import find_objects, label

    chamber = largest(mask)
    pieces, _ = label(mask & ~chamber)
    bridges: list[Bridge] = []
    boxes = dict(enumerate(find_objects(pieces), 1)) if thick(spacing) else {}
    waiting = [k for k, box in boxes.items() if _is_thin_vein(pieces[box] == k, spacing)]
    near = True
    while near:  # a piece may continue one that has just been joined
        near = False
        for k in tuple(waiting):
            ends = _find_near_end(pieces, k, boxes[k], chamber, spacing)
            if ends is not None:
                bridges.append(Bridge(*ends, pieces[ends[0]] == k, chamber[ends[1]].copy()))
                chamber[boxes[k]] |= pieces[boxes[k]] == k
                waiting.remove(k)
                near = True
    return chamber, bridges


def _is_thin_vein(piece: Mask, spacing: Array) -> bool:
    """Return whether a piece, cut out, is as wide as a vein that slices may lose, and no dust."""
    if min(piece.shape[1:]) < 3:  # saves time: there may be 100 000 grains
        return False
    radii = [
        _distance_to_section(section, spacing).max()
        for section in np.pad(~piece, 1, constant_values=True)[1:-1]
    ]
    return bool(THINNEST * spacing[1:].max() < max(radii) <= WIDEST * spacing[0])


def _find_near_end(
    pieces: NDArray[Any], k: int, box: tuple[slice, ...], chamber: Mask, spacing: Array
) -> tuple[int, int] | None:
    """Return the slice at an end of piece k and the slice beyond it, where the chamber is near, and nearer
    than in the piece's own slice; None where it is not.
    """
    reach = FARTHEST * spacing[0] + spacing[1:].max()  # from centre to centre
    margins = (1, *np.ceil(reach / spacing[1:]).astype(int))
    window = tuple(slice(max(0, side.start - m), side.stop + m) for side, m in zip(box, margins, strict=True))
    piece, near, first = pieces[window] == k, chamber[window], window[0].start
    for start, end in ((box[0].start, box[0].start - 1), (box[0].stop - 1, box[0].stop)):
        own, gap = (
            _distance_to_section(near[z - first], spacing)[piece[start - first]].min()
            if 0 <= z - first < len(near) and near[z - first].any()
            else np.inf
            for z in (start, end)
        )
        if gap < own and gap <= reach:
            return start, end
    return None


def _distance_to_section(section: Mask, spacing: Array) -> Array:
    """Return the distance to the nearest voxel of a section (rows, columns) from everywhere in it."""
    from scipy.ndimage import distance_transform_edt

    return np.asarray(distance_transform_edt(~section, sampling=spacing[1:]))
