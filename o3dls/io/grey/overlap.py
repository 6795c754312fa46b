"""Whether a prior lies in an image, and in which frame: what both state is compared with where they lie."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...geometry.similarity import TURN, apply, inverse
from ..images.layout import Volume

# shares of a prior inside an image: of the frame that is right, and of the wrong one
INSIDE, OUTSIDE = 0.95, 0.5
LARGEST_BODY = 2500.0  # mm, along an axis
FACTORS = {"m": 1000.0, "cm": 10.0, "um": 0.001}


def check_size(path: Path, volume: Volume) -> None:
    """Raise InputError where an image is larger than a body, whose lengths are of wrong units then."""
    if (extent := _extent(volume)) > LARGEST_BODY:
        raise InputError(
            f"{path}: extends over {extent:.4g} mm by its header, more than a body: it must state sizes and "
            "origin in mm"
        )


def _extent(volume: Volume) -> float:
    """Return the length of the longest axis in mm, as the header has it."""
    return float((np.linalg.norm(volume.affine[:3, :3], axis=0) * volume.shape).max())


def settle_frame(path: Path, volume: Volume, vertices: Array, prior_frame: str) -> tuple[str, Array]:
    """Return the frame of prior and image, and what turns the image into it: by what both state, else by
    where the prior lies in the image. Raises InputError where that does not tell.
    """
    known = "unknown" not in (volume.space, prior_frame)
    if known or volume.space == prior_frame:
        turn = TURN if {volume.space, prior_frame} == {"LPS", "RAS"} else np.eye(4)
        _check_overlap(path, volume, vertices, turn)
        return prior_frame, turn
    same, turned = (_share_inside(volume, vertices, turn) for turn in (np.eye(4), TURN))
    if max(same, turned) == 0.0:
        _check_overlap(path, volume, vertices, np.eye(4))
    if max(same, turned) < INSIDE or min(same, turned) > OUTSIDE:
        which = "prior" if prior_frame == "unknown" else "image"
        remedy = (
            "write it into its file: o3dls convert PRIOR prior.ply --frame LPS (or RAS)"
            if which == "prior"
            else "save it as NIfTI, or as NRRD with its space"
        )
        raise InputError(
            f"{path}: the frame of the {which} is not known, and the image holds {same:.0%} of the prior in "
            f"the one frame and {turned:.0%} in the other (LPS, RAS), which does not tell them apart; "
            f"{remedy}"
        )
    stated = volume.space if prior_frame == "unknown" else prior_frame
    if same > turned:
        return stated, np.eye(4)
    return {"LPS": "RAS", "RAS": "LPS"}[stated] if prior_frame == "unknown" else stated, TURN


def _share_inside(volume: Volume, vertices: Array, turn: Array, factor: float = 1.0) -> float:
    """Return the share of vertices inside the volume, where it is turned and its lengths are `factor` times
    as long.
    """
    affine = np.diag([factor, factor, factor, 1.0]) @ turn @ volume.affine
    return share_inside(affine, volume.shape, vertices)


def share_inside(affine: Array, shape: tuple[int, int, int], vertices: Array) -> float:
    """Return the share of vertices (n, 3) inside voxels (i, j, k) whose affine takes an index to mm."""
    index = apply(inverse(affine), vertices)
    inside = ((index >= -0.5) & (index <= np.array(shape) - 0.5)).all(axis=1)
    return float(inside.mean())


def _check_overlap(path: Path, volume: Volume, vertices: Array, turn: Array) -> None:
    """Raise InputError where no vertex lies in the image, with what may be the reason."""
    share = _share_inside(volume, vertices, turn)
    if share >= OUTSIDE:
        return
    said = (
        f"{path}: the prior does not lie in this image: it holds {share:.0%} of its {len(vertices)} vertices"
    )
    extent = _extent(volume)
    others = {
        unit: _share_inside(volume, vertices, turn, factor) if extent * factor <= LARGEST_BODY else 0.0
        for unit, factor in FACTORS.items()
    }
    unit = max(others, key=lambda name: others[name])
    if others[unit] > INSIDE:
        raise InputError(
            f"{said}, and {others[unit]:.0%} of them if the image's lengths were in {unit}: its header must "
            "state sizes and origin in mm"
        )
    if share > 0.0:
        return
    if _share_inside(volume, vertices, TURN @ turn) > OUTSIDE:
        raise InputError(
            f"{said}, and most of them with left and right, front and back exchanged: one of the two files "
            "states the wrong frame (LPS or RAS)"
        )
    corners = apply(turn @ volume.affine, list(product(*((0, n - 1) for n in volume.shape))))
    ranges = [
        ", ".join(f"{axis} {low:.0f} to {high:.0f}" for axis, low, high in zip("xyz", *ends, strict=True))
        for ends in ((one.min(axis=0), one.max(axis=0)) for one in (corners, vertices))
    ]
    raise InputError(
        f"{said} (image: {ranges[0]} mm; prior: {ranges[1]} mm); name the image that the prior was segmented "
        "in"
    )
