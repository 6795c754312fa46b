"""Label volumes (NIfTI, NRRD, MetaImage) to surfaces: one chamber, sub-voxel, closed, in mm and LPS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import Answer, Doubt, InputError, choices, did_you_mean
from ..meshes.surface_file import SurfaceFile
from ..text import is_count, listed
from .pieces import joined
from .registry import knows, read_image
from .sidecar import DECIDED
from .voxels import Image, whole_values
from .wall import cut_area, mask_surface, slices_first
from .whole import (
    AROUND,
    blank_slices,
    check_layout,
    check_taken,
    count_blank,
    share_of_border,
    slices_filled,
)

__all__ = ["knows", "read"]
MANY_LABELS = 200  # different ones: an atlas of the whole body has some hundred
MOST_LABELS = 1000  # more are no labels, whatever is said of them
Box = tuple[float, float, float, float, float, float]


class Choice(TypedDict, total=False):
    """These options choose a surface of a label volume; `surface_of` says what each means."""

    label: int | None
    part: str | None
    box: Box | None
    layer: int | None
    fill_slices: bool
    form: str | None


def read(path: Path, data: bytes, **choice: Any) -> SurfaceFile:
    """Read the surface of a label volume from a file; `frame`, `form` and `sidecar` are those of
    `read_image`, the choice is that of `surface_of`.
    """
    image = read_image(path, data, *(choice.pop(key, None) for key in ("frame", "form", "sidecar")))
    return surface_of(image, str(path), **choice)


def surface_of(
    image: Image,
    path: str,
    *,
    label: int | None = None,
    part: str | None = None,
    box: Box | None = None,
    layer: int | None = None,
    fill_slices: bool = False,
) -> SurfaceFile:
    """Return the closed surface of one label, or of the segment named `part`; everything outside `box` (x, y,
    z least, then most) is cut off. `layer` is the index of the one that is meant of a volume with several,
    such as the phases of a cine; `fill_slices` interpolates blank slices; `path` names the image in errors.

    Only the largest connected piece is taken, and what goes on from it obliquely through thick slices
    (`pieces.py`). Raises InputError where the label is not there, must be said, or is not taken for the most
    part.
    """
    check_layout(image.values.shape, path)
    values, label = _choose_label(path, image, label, part, layer)
    if (around := share_of_border(values, label)) > AROUND:
        others = [n for n in _find_labels(path, values, None) if n != label]
        raise Doubt(
            f"{path}: label {label} covers {around:.0%} of the outermost voxels of the volume: it is the "
            "background, or the mask is inverted",
            f"say the label of the chamber with --label ({', '.join(map(str, others)) or 'none is there'})",
            _list_answers({}, "label", others),
        )
    mask, affine = _cut_out(values, label, image.affine)
    if box is not None:
        mask &= _voxels_in_box(mask.shape, affine, box)
    if not mask.any():
        raise InputError(
            f"{path}: no voxel of label {label} {'is there' if box is None else 'lies in the box'}"
        )
    mask, affine, spacing = slices_first(mask, affine)
    blank = count_blank(blank_slices(mask)[1])
    mask = slices_filled(mask, spacing) if fill_slices else mask
    chamber, bridges = joined(mask, spacing)
    check_taken(mask, chamber, affine, f"{path}: label {label}")
    surface = mask_surface(chamber, affine, f"{path}: label {label}")
    voxels = int(chamber.sum())
    dropped = int(mask.sum()) - voxels
    facts: dict[str, Any] = {"label": label, "voxels": voxels, "voxels_of_smaller_pieces": dropped}
    if stated := image.notes.get("units"):
        facts["stated_units"] = stated
    of_blank = (
        "blank slices within it are interpolated"
        if fill_slices
        else "blank slices lie within it; --fill-slices interpolates them"
    )
    said = (
        (len(bridges), "thin pieces that only the gap between two slices parts are joined to the chamber"),
        (dropped, f"voxels of smaller pieces are left out, {dropped / (voxels + dropped):.1%} of the label"),
        (blank, of_blank),
    )
    notes = [image.notes[DECIDED]] if DECIDED in image.notes else []
    notes += [f"{count} {sentence}" for count, sentence in said if count]
    if area := cut_area(chamber, spacing):
        notes.append(
            f"the border of the volume cuts the label off: {area / 100:.1f} cm² of its surface are flat caps "
            "there, and no wall"
        )
    return SurfaceFile(surface, image.space, "mm", facts, tuple(notes))


def _named_segments(notes: Mapping[str, str]) -> dict[str, tuple[int, int]]:
    """Return the names of a Slicer segmentation with their layer and label."""
    found = {}
    k = 0
    while f"Segment{k}_Name" in notes:
        numbers = [notes.get(f"Segment{k}_{key}", "").strip() for key in ("Layer", "LabelValue")]
        layer, label = (
            int(text) if is_count(text) else default for text, default in zip(numbers, (0, 1), strict=True)
        )
        found[notes[f"Segment{k}_Name"].strip()] = (layer, label)
        k += 1
    return found


def _choose_label(
    path: str, image: Image, label: int | None, part: str | None, layer: int | None
) -> tuple[NDArray[Any], int]:
    """Return the layer and the label in it that are meant; where nothing is said there must be one only."""
    layers = image.values if image.values.ndim == 4 else image.values[..., None]
    segments = _named_segments(image.notes)
    given = [f"{k} {v!r}" for k, v in (("label", label), ("part", part), ("layer", layer)) if v is not None]
    if part is not None and len(given) > 1:
        raise InputError(f"{path}: {' and '.join(given)} are both given; say the one that is meant")
    if part is not None:
        if part not in segments:
            raise InputError(
                f"{path}: has no segment '{part}'" + (did_you_mean(part, list(segments)) if segments else "")
            )
        layer, label = segments[part]
        return layers[..., _check_layer(path, layer, layers.shape[-1], f"segment '{part}' is in")], label
    numbers = (
        range(layers.shape[-1])
        if layer is None
        else [_check_layer(path, layer, layers.shape[-1], "there is no")]
    )
    found = {k: _find_labels(path, layers[..., k], None if label == 0 else 0) for k in numbers}
    labels = sorted({value for values in found.values() for value in values})
    parts = segments if label is None and layer is None else {}  # a part is said without the others
    hint = _hint_options(parts, f"--label (there are {', '.join(map(str, labels))})")
    if label is None:
        if len(labels) > MANY_LABELS and not segments:
            raise InputError(
                f"{path}: holds {len(labels)} different values, which looks like a grey image, not a label "
                "volume: segment the chamber first and save its labels; if these are labels, say --label"
            )
        if len(labels) != 1:
            raise Doubt(f"{path}: holds {len(labels)} labels", hint, _list_answers(parts, "label", labels))
        (label,) = labels
    layers_of = [k for k, values in found.items() if label in values]
    if len(layers_of) > 1:
        raise Doubt(
            f"{path}: label {label} is in {len(layers_of)} layers",
            _hint_options(parts, f"--layer ({listed(layers_of)})"),
            _list_answers(parts, "layer", layers_of),
        )
    if not layers_of:
        raise Doubt(f"{path}: has no label {label}", hint, _list_answers(parts, "label", labels))
    return layers[..., layers_of[0]], label


def _check_layer(path: str, layer: int, number: int, what: str) -> int:
    if not 0 <= layer < number:
        raise InputError(f"{path}: {what} layer {layer}: there are {number}, counted from 0")
    return layer


def _list_answers(segments: Mapping[str, Any], key: str, values: Sequence[int]) -> list[Answer]:
    """Return the answers that say which label or layer is meant; the names of segments say it better."""
    return choices("part", list(segments)) if segments else choices(key, values, key + " {}")


def _hint_options(segments: Mapping[str, Any], option: str) -> str:
    """Return the options that say which label or layer is meant: the one named, or a segment of those there
    are.
    """
    parts = [f"--part ({', '.join(segments)})"] if segments else []
    return "say " + " or ".join([option, *parts])


def _find_labels(path: str, values: NDArray[Any], outside: int | None) -> list[int]:
    """Return the labels other than that of the `outside`. Raises InputError for an image of grey values.

    Slice by slice from the middle, where a grey image shows what it is: it may be large, and is not copied.
    """
    middle = len(values) // 2
    found: set[int] = set()
    for k in sorted(range(len(values)), key=lambda k: abs(k - middle)):
        found |= whole_values(path, values[k])
        if len(found) > MOST_LABELS:
            raise InputError(
                f"{path}: holds more than {MOST_LABELS} different values; it is an image, not a label volume"
            )
    return sorted(found - {outside})


def _cut_out(values: NDArray[Any], label: int, affine: Array) -> tuple[NDArray[np.bool_], Array]:
    """Return the voxels of a label, cut out with a margin of one voxel where the volume goes on, and the
    affine of their indices: what follows takes many times the memory of its mask. Slice by slice, so that the
    volume is not copied.
    """
    columns = np.zeros(values.shape[1:], dtype=bool)
    slices = np.zeros(len(values), dtype=bool)
    for k, one in enumerate(values):
        there = one == label
        slices[k] = there.any()
        columns |= there
    used = (slices, columns.any(axis=1), columns.any(axis=0))
    window = tuple(_range_of(np.asarray(one), size) for one, size in zip(used, values.shape, strict=True))
    first = np.array([side.start for side in window][::-1])
    moved = affine.copy()
    moved[:3, 3] += affine[:3, :3] @ first
    return np.asarray(values[window] == label), moved


def _range_of(used: NDArray[np.bool_], size: int) -> slice:
    """Return what is used along an axis, with one more on either side where the axis goes on; all of it where
    nothing is.
    """
    places = np.flatnonzero(used)
    return slice(max(0, places[0] - 1), min(size, places[-1] + 2)) if len(places) else slice(0, size)


def _voxels_in_box(shape: tuple[int, ...], affine: Array, box: Box) -> NDArray[np.bool_]:
    """Return voxels whose centre lies in the box, (nz, ny, nx)."""
    k, j, i = np.indices(shape, sparse=True)
    inside = np.ones(shape, dtype=bool)
    for axis in range(3):
        position = affine[axis, 0] * i + affine[axis, 1] * j + affine[axis, 2] * k + affine[axis, 3]
        inside &= (position >= box[axis]) & (position <= box[axis + 3])
    return inside
