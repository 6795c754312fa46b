"""A JSON file beside a volume, as dcm2niix writes it, against the volume's own header."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...arrays import Array
from ...case import MILLIMETRES
from ...errors import Answer, Doubt, InputError
from ..documents import read_json
from .voxels import Image

DECIDED = "decided on the sidecar"  # the note of an image
SAME_SIZE = 0.01  # share of a voxel's size: numbers of either file are rounded
PARALLEL = 0.999  # cosine of 2.6 degrees
MOST_THICK = 3.0  # slices are not so many times thicker than they are apart, nor thinner
LARGEST = 1e6  # mm
SUFFIX = re.compile(r"\.(nii|hdr)(\.gz)?$|\.(nrrd|nhdr|mha|mhd)$", re.IGNORECASE)
VOLUME = (Answer("the volume is right", {"sidecar": "ignore"}),)
LENGTHS = [unit for unit in MILLIMETRES if unit != "px"]
ORIENTATIONS = ("ImageOrientationPatientDICOM", "ImageOrientationPatient")


class Fault(NamedTuple):
    """A fault is that a sidecar and a volume contradict: `said` names both statements, `factors` (3,) are
    those by which the axes i, j and k become as the sidecar says, None where it cannot say that; `units` are
    the sidecar's where these are the fault.
    """

    said: str
    factors: Array | None
    units: str | None = None


def agreed(path: Path, image: Image, decided: str | None) -> Image:
    """Return the image as its header and the JSON sidecar agree on it, or as it was `decided`: `ignore` the
    sidecar, or `take` what it says in place of the header.

    Raises InputError where they contradict and nothing is decided, and for a decision on no sidecar.
    """
    beside = path.with_name(SUFFIX.sub("", path.name) + ".json")
    if not (SUFFIX.search(path.name) and beside.is_file()):
        if decided is not None:
            raise InputError(f"{path}: no JSON sidecar {beside.name} is beside it: omit --sidecar")
        return image
    fault = _find_fault(_read_statements(beside), image)
    if fault is None:
        return image
    said = f"{beside.name} beside it {fault.said}"
    if decided == "ignore":
        return replace(image, notes={**image.notes, DECIDED: f"{said}; it is ignored, as --sidecar says"})
    if fault.factors is None:
        raise Doubt(
            f"{path}: {said}: one is of another image",
            "say --sidecar ignore where the volume is right, else orient it first, as in 3D Slicer",
            VOLUME,
        )
    if decided is None:
        raise Doubt(
            f"{path}: {said}: one is of another image, or the header was changed",
            "say --sidecar ignore where the volume is right, --sidecar take where the sidecar is",
            [*VOLUME, Answer("the sidecar is right", {"sidecar": "take"})],
        )
    affine = image.affine @ np.diag([*fault.factors, 1.0])
    notes = {**image.notes, DECIDED: f"{said}; the sidecar is taken, as --sidecar says"}
    if fault.units is not None:  # they scale the origin too
        affine[:3, 3] *= fault.factors[0]
        notes["units"] = fault.units
    return replace(image, affine=affine, notes=notes)


def check_agreed(path: Path, image: Image) -> None:
    """Raise InputError where a JSON sidecar contradicts a grey image, of which no option decides."""
    beside = path.with_name(SUFFIX.sub("", path.name) + ".json")
    if not (SUFFIX.search(path.name) and beside.is_file()):
        return
    if fault := _find_fault(_read_statements(beside), image):
        raise InputError(
            f"{path}: {beside.name} beside it {fault.said}: one is of another image, or the header was "
            "changed; correct the one that is wrong"
        )


def _read_statements(path: Path) -> Mapping[str, Any]:
    """Return what a sidecar states; nothing where it is no table of JSON, which contradicts nothing."""
    try:
        found = read_json(path)
    except InputError:
        return {}
    return found if isinstance(found, dict) else {}


def _find_fault(stated: Mapping[str, Any], image: Image) -> Fault | None:
    """Return the first contradiction, the one that changes most first."""
    units, ours = (stated.get("units", stated.get("Units")), image.notes.get("units", "mm"))
    ours = ours if ours in MILLIMETRES else "mm"
    if units in LENGTHS and units != ours:  # those of BIDS may be of the values
        factors = np.full(3, MILLIMETRES[units] / MILLIMETRES[ours])
        return Fault(f"states units {units}, the volume {ours}", factors, units)
    directions = image.affine[:3, :3] / image.spacing
    rows = _read_orientation(stated, image.space)
    if rows is not None:
        least = float(np.abs(rows @ directions).max(axis=1).min())  # of row and column, to the nearest axis
        if least < PARALLEL:
            angle = np.degrees(np.arccos(least))
            said = f"states slices that lie {angle:.0f} degrees off the axes of the volume"
            return Fault(said, None)
    return _compare_slices(stated, image, rows, directions) or _compare_pixels(
        stated, image, rows, directions
    )


def _read_orientation(stated: Mapping[str, Any], space: str) -> Array | None:
    """Return the directions of a row and of a column of a slice (2, 3) in LPS; None where they are not said,
    or the volume does not say how it lies.
    """
    found = next((values for key in ORIENTATIONS if (values := _numbers(stated.get(key), 6))), None)
    if found is None or space != "LPS":
        return None
    rows = np.reshape(found, (2, 3))
    return rows if (np.abs(np.linalg.norm(rows, axis=1) - 1.0) < SAME_SIZE).all() else None


def _compare_slices(
    stated: Mapping[str, Any], image: Image, rows: Array | None, directions: Array
) -> Fault | None:
    """Compare the distance of slices with the one that is stated, else with their thickness, which gaps and
    overlaps make another number.

    Without an orientation slices follow along the third axis, but axes may have been reordered.
    """
    axis = 2 if rows is None else int(np.abs(np.cross(*rows) @ directions).argmax())
    found = float(image.spacing[axis])
    apart, thick = (_sizes([stated.get(key)], 1) for key in ("SpacingBetweenSlices", "SliceThickness"))
    if apart:
        (said,) = apart
        near = image.spacing if rows is None else image.spacing[[axis]]
        wrong = bool((np.abs(near - said) > SAME_SIZE * said).all())
    elif thick:
        (said,) = thick
        wrong = not said / MOST_THICK <= found <= said * MOST_THICK
    else:
        return None
    factors = np.where(np.arange(3) == axis, said / found, 1.0)
    words = f"states slices {said:g} mm {'apart' if apart else 'thick'}, the volume {found:.4g} mm apart"
    return Fault(words, factors) if wrong else None


def _compare_pixels(
    stated: Mapping[str, Any], image: Image, rows: Array | None, directions: Array
) -> Fault | None:
    """Compare the distances of pixels in a slice, of which DICOM states that of the rows first."""
    pixels = _sizes(stated.get("PixelSpacing"), 2)
    if not pixels:
        return None
    axes = [0, 1] if rows is None else np.abs(rows @ directions).argmax(axis=1).tolist()
    found, said = image.spacing[axes], np.array(pixels[::-1])
    if (np.abs(found - said) <= SAME_SIZE * said).all():
        return None
    factors = np.ones(3)
    factors[axes] = said / found
    ours, theirs = (" x ".join(f"{size:.4g}" for size in sizes) for sizes in (found, said))
    return Fault(f"states pixels of {theirs} mm, the volume {ours} mm", factors)


def _numbers(values: Any, count: int) -> list[float] | None:
    """Return so many numbers; None for anything else."""
    if not isinstance(values, list) or len(values) != count:
        return None
    whole = all(type(value) in (int, float) and abs(value) < LARGEST for value in values)
    return [float(value) for value in values] if whole else None


def _sizes(values: Any, count: int) -> list[float] | None:
    """Return so many positive numbers; None for anything else."""
    found = _numbers(values, count)
    return found if found and min(found) > 0.0 else None
