"""Label volumes (NIfTI, NRRD, MetaImage) to surfaces: one chamber, sub-voxel, closed, in mm and LPS."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import InputError, did_you_mean
from ..meshes.surface_file import SurfaceFile
from ..text import is_count
from .pieces import joined
from .registry import knows, read_image
from .voxels import Image
from .wall import mask_surface, slices_first

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


def read(path: Path, data: bytes, *, frame: str | None = None, **choice: Any) -> SurfaceFile:
    """Read the surface of a label volume from a file; `frame` is that of its axes where the file does not say
    how they lie, the choice is that of `surface_of`.
    """
    return surface_of(read_image(path, data, frame), str(path), **choice)


def surface_of(
    image: Image,
    path: str,
    *,
    label: int | None = None,
    part: str | None = None,
    box: Box | None = None,
    layer: int | None = None,
) -> SurfaceFile:
    """Return the closed surface of one label, or of the segment named `part`; everything outside `box` (x, y,
    z least, then most) is cut off. `layer` is the index of the one that is meant of a volume with several,
    such as the phases of a cine; `path` names the image in errors.

    Only the largest connected piece is taken, and what goes on from it obliquely through thick slices
    (`pieces.py`). Raises InputError where the label is not there, or must be said.
    """
    values, label = _choose_label(path, image, label, part, layer)
    mask = np.asarray(values == label)
    if box is not None:
        mask &= _voxels_in_box(mask.shape, image.affine, box)
    if not mask.any():
        raise InputError(
            f"{path}: no voxel of label {label} {'is there' if box is None else 'lies in the box'}"
        )
    mask, affine, spacing = slices_first(mask, image.affine)
    chamber, bridges = joined(mask, spacing)
    surface = mask_surface(chamber, affine, f"{path}: label {label}")
    voxels = int(chamber.sum())
    dropped = int(mask.sum()) - voxels
    facts = {"label": label, "voxels": voxels, "voxels_of_smaller_pieces": dropped}
    said = (
        (len(bridges), "thin pieces that only the gap between two slices parts are joined to the chamber"),
        (dropped, "voxels of smaller pieces are left out"),
    )
    notes = tuple(f"{count} {sentence}" for count, sentence in said if count)
    return SurfaceFile(surface, image.space, "mm", facts, notes)


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
    found = {k: _find_labels(path, layers[..., k]) for k in numbers}
    labels = sorted({value for values in found.values() for value in values})
    hint = _hint_options(segments, f"--label (there are {', '.join(map(str, labels))})")
    if label is None:
        if len(labels) > MANY_LABELS and not segments:
            raise InputError(
                f"{path}: holds {len(labels)} different values, which looks like a grey image, not a label "
                "volume: segment the chamber first and save its labels; if these are labels, say --label"
            )
        if len(labels) != 1:
            raise InputError(f"{path}: holds {len(labels)} labels" + hint)
        (label,) = labels
    layers_of = [k for k, values in found.items() if label in values]
    if len(layers_of) > 1:
        raise InputError(
            f"{path}: label {label} is in {len(layers_of)} layers"
            + _hint_options(segments, f"--layer ({layers_of[0]} to {layers_of[-1]})")
        )
    if not layers_of:
        raise InputError(f"{path}: has no label {label}" + hint)
    return layers[..., layers_of[0]], label


def _check_layer(path: str, layer: int, number: int, what: str) -> int:
    if not 0 <= layer < number:
        raise InputError(f"{path}: {what} layer {layer}: there are {number}, counted from 0")
    return layer


def _hint_options(segments: Mapping[str, Any], option: str) -> str:
    """Return the options that say which label or layer is meant: the one named, or a segment of those there
    are.
    """
    parts = [f"--part ({', '.join(segments)})"] if segments else []
    return "; say " + " or ".join([option, *parts])


def _find_labels(path: str, values: NDArray[Any]) -> list[int]:
    """Return the labels other than 0. Raises InputError for an image of grey values.

    Slice by slice from the middle, where a grey image shows what it is: it may be large, and is not copied.
    """
    middle = len(values) // 2
    found: set[int] = set()
    for k in sorted(range(len(values)), key=lambda k: abs(k - middle)):
        found |= _whole_values(path, values[k])
        if len(found) > MOST_LABELS:
            raise InputError(
                f"{path}: holds more than {MOST_LABELS} different values; it is an image, not a label volume"
            )
    return sorted(found - {0})


def _whole_values(path: str, values: NDArray[Any]) -> set[int]:
    """Return the different values of a slice. Raises InputError where one is not a whole number."""
    found = np.unique(values)
    if found.dtype.kind == "f" and not ((found == np.round(found)) & (np.abs(found) < 1e9)).all():
        raise InputError(
            f"{path}: holds values that are not whole numbers; it is an image, not a label volume"
        )
    return {int(value) for value in found}


def _voxels_in_box(shape: tuple[int, ...], affine: Array, box: Box) -> NDArray[np.bool_]:
    """Return voxels whose centre lies in the box, (nz, ny, nx)."""
    k, j, i = np.indices(shape, sparse=True)
    inside = np.ones(shape, dtype=bool)
    for axis in range(3):
        position = affine[axis, 0] * i + affine[axis, 1] * j + affine[axis, 2] * k + affine[axis, 3]
        inside &= (position >= box[axis]) & (position <= box[axis + 3])
    return inside
