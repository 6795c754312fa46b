"""The wall of a mask as a smooth surface between its voxels, however thick the slices are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array, Mask
from ...errors import InputError
from ...geometry.cut_wall import CUT
from ...geometry.similarity import apply
from ...geometry.surface import Surface
from .pieces import Bridge, filled, joined, thick, wide

# standard deviations, in voxels, of the filters that take the steps of the voxels away
MASK_SMOOTHING = 0.7
DISTANCE_SMOOTHING = 1.5  # may be larger, since labels are kept
CLEARANCE = 0.1  # voxels: how far the wall stays from their centres at least
ROUNDS = 2  # a third moves the wall of an atrium by less than 0.01 mm in the mean
MOST_NODES = 4_000_000  # above it slices are divided less finely, so that a volume takes seconds
ON_CAP = 0.25  # voxels from its plane: the field bends where a cap meets the wall
PAD = 2  # voxels around a label: outside, but for the first past the border of the volume
Field = NDArray[np.float32]


def mask_surface(mask: Mask, affine: Array, name: str = "mask") -> Surface:
    """Return the closed surface between the voxels of a mask (nz, ny, nx); `affine` (4, 4) takes an index (i,
    j, k), a voxel's centre, to mm.

    What leaves the volume is closed by a flat cap half a voxel past its last, whose vertices have 1 in the
    field `cut_by_border`. Raises InputError where the mask is too thin to enclose anything.
    """
    import open3d as o3d

    mask, affine, spacing = slices_first(mask, affine)
    used = np.nonzero(mask)
    low, high = (np.array([ends(axis) for axis in used]) for ends in (np.min, np.max))
    part = filled(np.pad(mask[tuple(map(slice, low, high + 1))], PAD))
    if not wide(part).any():
        raise InputError(
            f"{name}: its {int(mask.sum())} voxels are too few or lie too thin to enclose anything"
        )
    borders = _borders_that_cut(mask)
    field = wall_field(_continue_past_borders(part, borders), spacing)
    for axis, end in borders:
        _cut_off(field.swapaxes(0, axis), end, parts_of(part, spacing) if axis == 0 else 1)
    mesh = o3d.t.geometry.TriangleMesh.create_isosurfaces(o3d.core.Tensor.from_numpy(-field), [0.0])
    indices = mesh.vertex.positions.numpy().astype(np.float64) / [1, 1, parts_of(part, spacing)]
    fields = {CUT: _mark_caps(indices, part.shape, borders).astype(np.float64)} if borders else {}
    surface = Surface(apply(affine, indices + low[::-1] - PAD), mesh.triangle.indices.numpy(), fields)
    # an affine that mirrors turns the faces inside out
    return surface if surface.volume > 0 else replace(surface, faces=surface.faces[:, ::-1])


def _mark_caps(indices: Array, shape: tuple[int, ...], borders: Sequence[tuple[int, int]]) -> Mask:
    """Return which vertices, by their indices (i, j, k) in a padded mask, lie on the caps at the borders."""
    caps = np.zeros(len(indices), dtype=bool)
    for axis, end in borders:
        plane = PAD - 0.5 if end == 0 else shape[axis] - PAD - 0.5
        caps |= np.abs(indices[:, 2 - axis] - plane) < ON_CAP
    return caps


def _borders_that_cut(mask: Mask) -> list[tuple[int, int]]:
    """Return the borders of a volume (axis, first or last) that a mask reaches; none where it reaches all:
    the volume was cut out around the label then, and none of them cuts it.
    """
    ends = [(axis, end) for end in (0, -1) for axis in range(3)]
    borders = [(axis, end) for axis, end in ends if mask.take(end, axis).any()]
    return borders if len(borders) < len(ends) else []


def cut_area(mask: Mask, spacing: Array) -> float:
    """Return the area, in mm² for a spacing (3,) in mm, of the flat caps where the border of the volume cuts
    a mask off.
    """
    cells = spacing.prod() / spacing
    return float(sum(mask.take(end, axis).sum() * cells[axis] for axis, end in _borders_that_cut(mask)))


def slices_first(mask: Mask, affine: Array) -> tuple[Mask, Array, Array]:
    """Return a mask with the axis along which its voxels are longest first, the affine of its indices, which
    run the other way, and the spacing (3,) along its axes.
    """
    spacing = np.linalg.norm(affine[:3, :3], axis=0)[::-1]
    thickest = int(spacing.argmax())
    order = [thickest, *(axis for axis in range(3) if axis != thickest)]
    columns = [*(2 - axis for axis in reversed(order)), 3]
    return mask.transpose(order), affine[:, columns], spacing[order]


def parts_of(mask: Mask, spacing: Array) -> int:
    """Return how many parts of a slice are about as thick as its voxels are wide, fewer for a large mask:
    odd, so that no node lies half-way between two slices, where a flat wall runs.
    """
    pairs = np.ceil((spacing[0] / spacing[1:].max() - 1.5) / 2.0)
    most = max(int(thick(spacing)), (MOST_NODES // mask.size - 1) // 2)
    return 1 + 2 * int(np.clip(pairs, 0, most))


def _continue_past_borders(mask: Mask, borders: Sequence[tuple[int, int]]) -> Mask:
    """Return a padded mask that goes on past the borders (axis, first or last) of its volume as it reaches
    them.
    """
    mask = mask.copy()
    for axis, end in borders:
        slices = mask.swapaxes(0, axis)
        slices[PAD - 1 if end == 0 else -PAD] = slices[PAD if end == 0 else -PAD - 1]
    return mask


def _cut_off(field: Field, end: int, parts: int) -> None:
    """Cut off what lies more than half a voxel past the volume, at one end of the first axis."""
    past = PAD - 0.5 - np.arange(len(field)) / parts
    np.maximum(field, (past if end == 0 else past[::-1]).astype(np.float32)[:, None, None], out=field)


def wall_field(mask: Mask, spacing: Array) -> Field:
    """Return a field that is negative inside the smooth wall of a mask (slices, rows, columns) with outside
    all around, on its slices and on those that part them.

    Where slices are thick, shape-based interpolation (Raya and Udupa 1990) with distances in space: these
    change evenly from slice to slice also where a part ends between two, and a better wall gives better
    distances. The centre of a voxel keeps its label, and so does what lies between two of one label.
    """
    parts = parts_of(mask, spacing)
    side = np.where(mask, -1.0, 1.0).astype(np.float32)
    if parts == 1:
        return _keep_on_side(_smooth_steps(side, MASK_SMOOTHING), side, 2.0 * CLEARANCE)
    least = CLEARANCE * spacing.min()
    distance = _distance_to_wall(mask, spacing)
    for _ in range(ROUNDS):
        inside = _interpolate_slices(distance, parts) < 0.0
        distance = _smooth_steps(_distance_to_wall(inside, spacing / [parts, 1, 1]), DISTANCE_SMOOTHING)
        distance = _keep_on_side(distance[::parts], side, least)
    field = _interpolate_slices(distance, parts)
    for bridge in joined(mask, spacing)[1]:
        _unite_bridge(field, bridge, parts, spacing)
    return field


def _keep_on_side(values: Field, side: Field, least: float) -> Field:
    return np.asarray(side * np.maximum(side * values, np.float32(least)))


def _distance_to_wall(inside: Mask, spacing: Array) -> Field:
    """Return the distance of every voxel's centre to the other side, negative inside; the wall lies half a
    voxel before the nearest centre there.
    """
    from scipy.ndimage import distance_transform_edt

    distance = distance_transform_edt(~inside, sampling=spacing).astype(np.float32)
    distance -= distance_transform_edt(inside, sampling=spacing)
    return np.asarray(distance + np.where(inside, 0.5, -0.5) * np.float32(spacing.min()), dtype=np.float32)


def _smooth_steps(values: Field, deviation: float) -> Field:
    """Return values without the steps of the voxels; what the filter takes from curved walls, its second pass
    gives back.
    """
    from scipy.ndimage import gaussian_filter

    once = gaussian_filter(values, deviation)
    return np.asarray(once + gaussian_filter(values - once, deviation))


def _interpolate_slices(values: Field, parts: int) -> Field:
    """Return values (slices, rows, columns) with `parts` - 1 slices more in every gap: monotone cubics
    (Fritsch and Butland 1984), so that the sign does not change between two of one sign.
    """
    from scipy.interpolate import PchipInterpolator

    places = np.arange(len(values))
    fine = np.arange((len(values) - 1) * parts + 1) / parts
    out = np.empty((len(fine), *values.shape[1:]), dtype=np.float32)
    for row in range(values.shape[1]):  # all at once would take five times the memory
        out[:, row] = PchipInterpolator(places, values[:, row])(fine)
    return out


def _unite_bridge(field: Field, bridge: Bridge, parts: int, spacing: Array) -> None:
    """Unite the field with a tube from slice to slice: the piece's section slides to where the chamber's
    covers it best, and becomes what is common to both on the way.
    """
    from scipy.ndimage import shift

    piece, chamber = (_distance_to_wall(section, spacing[1:]) for section in (bridge.piece, bridge.chamber))
    centre = np.unravel_index(piece.argmin(), piece.shape)
    offset = np.stack([axis - at for axis, at in zip(np.indices(piece.shape), centre, strict=True)])
    way = np.linalg.norm(offset * spacing[1:, None, None], axis=0)
    target = np.argmin(np.where(bridge.chamber, way + 2.0 * np.maximum(chamber - piece.min(), 0.0), np.inf))
    move = offset.reshape(2, -1)[:, target]
    common = np.maximum(chamber, shift(piece, move, order=1, mode="nearest"))
    for k in range(1, parts):
        t = k / parts
        tube = (1.0 - t) * shift(piece, t * move, order=1, mode="nearest")
        tube += t * shift(common, (t - 1.0) * move, order=1, mode="nearest")
        level = field[bridge.start * parts + (bridge.end - bridge.start) * k]
        np.minimum(level, tube, out=level)
