"""A DICOM series, a folder with one file for each slice, as a grey image, by pydicom."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ..images.dicom import is_dicom
from ..images.layout import WHOLE, Grey, Window
from ..images.voxels import check_affine

# share of the distance of two slices, or mm: places are rounded, and a missing slice doubles it
SAME_STEP = 0.1
SAME_DIRECTION = 1e-3  # of the entries of unit vectors
NEEDED = ("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "Rows", "Columns")
AS_ONE_FILE = "save it as NIfTI or NRRD, as dcm2niix and 3D Slicer do"


@dataclass(frozen=True, eq=False)
class Slice:
    """A slice lies at a position (3,), with unit directions (2, 3) along a row and down a column, and
    spacings (2,) of rows and of columns; size: columns and rows.
    """

    path: Path
    series: str
    description: str
    size: tuple[int, int]
    position: Array
    rows: Array
    spacing: Array


@dataclass(frozen=True, eq=False)
class Series:
    """A series has the files of its slices in their order along the body, and how they lie, in LPS."""

    path: Path
    files: tuple[Path, ...]
    shape: tuple[int, int, int]
    affine: Array
    space: str = "LPS"

    def check(self) -> None:
        """Raise InputError where a slice cannot be read: they are read one by one."""
        for k in range(len(self.files)):
            self.slab(k, k + 1)

    def slab(self, low: int, high: int, window: Window = WHOLE) -> Grey:
        """Read the window of the slices from `low` on, before `high`, (high - low, nj, ni)."""
        return np.stack([_read_slice(path, self.shape)[window] for path in self.files[low:high]])


def read_series(folder: Path) -> Series:
    """Read how the slices of the one series in a folder lie. Raises InputError where there is none or
    several, or the slices are not parallel and at equal distances.
    """
    try:
        import pydicom
    except ImportError:
        raise InputError(
            f"{folder}: to read a folder of DICOM files install pydicom, pip install 'o3dls[dicom]', or "
            f"{AS_ONE_FILE}"
        ) from None
    slices = []
    for path in sorted(path for path in folder.iterdir() if is_dicom(path)):
        with _readable(path):
            slices.append(_read_place(path, pydicom.dcmread(path, stop_before_pixels=True)))
    if not slices:
        raise InputError(
            f"{folder}: is a folder without DICOM files; name the folder that holds the slices, or a file "
            "(NIfTI, NRRD, MetaImage)"
        )
    _check_one_series(folder, slices)
    return _ordered(folder, slices)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Raise InputError for whatever pydicom raises, which on a damaged file is of any class."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of values that are longer or odder than DICOM allows
        try:
            yield
        except InputError:
            raise
        except Exception as error:
            said = " ".join(str(error).split())[:200]
            raise InputError(f"{path}: cannot be read as a slice of DICOM: {said}") from None


def _read_place(path: Path, head: Any) -> Slice:
    """Return where a slice lies. Raises InputError for a file that is no slice of grey values with its place
    in the body.
    """
    lacking = [name for name in NEEDED if head.get(name) is None]
    if lacking or int(head.get("NumberOfFrames", 1)) > 1:
        what = f"has no {', '.join(lacking)}" if lacking else f"holds {head.NumberOfFrames} frames"
        raise InputError(f"{path}: {what}: must be one slice with its place in the body; {AS_ONE_FILE}")
    if int(head.get("SamplesPerPixel", 1)) != 1:
        raise InputError(f"{path}: has {head.SamplesPerPixel} samples per pixel: must be grey, with one")
    position, orientation, spacing = (np.array(head[name].value, dtype=np.float64) for name in NEEDED[:3])
    rows = orientation.reshape(2, 3)
    unit = np.abs(rows @ rows.T - np.eye(2)).max() < SAME_DIRECTION
    if not (unit and position.shape == (3,) and np.isfinite(position).all() and (spacing > 0.0).all()):
        raise InputError(
            f"{path}: place {position.tolist()}, directions {orientation.tolist()} and spacing "
            f"{spacing.tolist()} of its pixels are none of a slice: it is damaged"
        )
    uid, words = (str(head.get(name, "")) for name in ("SeriesInstanceUID", "SeriesDescription"))
    return Slice(path, uid, words, (int(head.Columns), int(head.Rows)), position, rows, spacing.reshape(2))


def _check_one_series(folder: Path, slices: Sequence[Slice]) -> None:
    found = Counter(one.series for one in slices)
    if len(found) > 1:
        names = {one.series: one.description or "no description" for one in slices}
        said = "; ".join(f"{names[uid]}: {count} files" for uid, count in found.items())
        raise InputError(
            f"{folder}: holds {len(found)} series ({said[:300]}); put the one that the prior was segmented "
            "in into a folder of its own"
        )


def _ordered(folder: Path, slices: Sequence[Slice]) -> Series:
    sizes = {one.size for one in slices}
    spacings, rows = np.array([one.spacing for one in slices]), np.array([one.rows for one in slices])
    if len(sizes) > 1 or max(np.ptp(spacings, axis=0).max(), np.ptp(rows, axis=0).max()) > SAME_DIRECTION:
        raise InputError(
            f"{folder}: its slices differ in size, in spacing or in direction, so they are no one volume; "
            "leave out the ones of another kind, such as localizers"
        )
    normal = np.cross(*rows[0])
    ordered = sorted(slices, key=lambda one: float(one.position @ normal))
    _check_steps(folder, np.array([one.position @ normal for one in ordered]))
    first, last, count = ordered[0], ordered[-1], len(ordered)
    affine = np.eye(4)
    affine[:3, 0], affine[:3, 1] = first.rows[0] * first.spacing[1], first.rows[1] * first.spacing[0]
    affine[:3, 2] = (last.position - first.position) / (count - 1)
    affine[:3, 3] = first.position
    where = f"{folder}: place and direction of its slices"
    files = tuple(one.path for one in ordered)
    return Series(folder, files, (*first.size, count), check_affine(where, affine))


def _check_steps(folder: Path, along: Array) -> None:
    """Raise InputError where slices at places `along` their normal are not at equal distances."""
    steps = np.diff(along)
    if len(steps) == 0:
        raise InputError(f"{folder}: holds one slice: a volume has several; name the folder of all of them")
    usual = float(np.median(steps))
    if steps.min() < SAME_STEP:
        raise InputError(
            f"{folder}: holds several slices at one place, as of phases in time: put those of the phase that "
            "the prior was segmented in into a folder of its own"
        )
    worst = int(np.abs(steps - usual).argmax())
    if abs(steps[worst] - usual) > max(SAME_STEP * usual, 0.01):
        raise InputError(
            f"{folder}: slices {worst + 1} and {worst + 2} of {len(along)} are {steps[worst]:.3g} mm apart, "
            f"the others {usual:.3g} mm: one is missing, or is of another series; export the series again"
        )


def _read_slice(path: Path, shape: tuple[int, int, int]) -> Grey:
    import pydicom

    with _readable(path):
        head = pydicom.dcmread(path)
        values = np.asarray(head.pixel_array, dtype=np.float32)
        if values.shape != shape[1::-1]:
            raise InputError(f"{path}: has {values.shape} pixels: was changed while it was read")
        slope, intercept = (head.get(name) for name in ("RescaleSlope", "RescaleIntercept"))
        slope, intercept = 1.0 if slope is None else float(slope), float(intercept or 0.0)
        return np.asarray(values * np.float32(slope) + np.float32(intercept), dtype=np.float32)
