"""DICOM segmentations (SEG), by highdicom; images and contours of DICOM are no labels, and are told so."""

from __future__ import annotations

import warnings
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .voxels import MOST_BYTES, PIECE, Image, check_affine, count

SEGMENTATIONS = (
    "1.2.840.10008.5.1.4.1.1.66.4",
    "1.2.840.10008.5.1.4.1.1.66.7",
)  # the one stores bits, the other labels
SEGMENT_FIRST = (
    "segment the left atrium first, for example in 3D Slicer (Segment Editor) or with TotalSegmentator, "
    "and save the labels as NRRD, NIfTI or DICOM SEG"
)
PIXELS = 0x7FE00010
MAY_FOLLOW = (b"\xfa\xff\xfa\xff", b"\xfc\xff\xfc\xff")  # tags of signatures and of padding
GROUP_LENGTH = b"\2\0\0\0UL\4\0"  # how long the head before the data set is
DEFLATED = b"1.2.840.10008.1.2.1.99"
PLAIN = ("1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2", DEFLATED.decode())
LONGEST_META = 1 << 16  # bytes of the head before the data set
FIRST_FILES = 50  # so many files of a folder are looked at
FEWEST_GAPS = 2  # between frames, which tell how far slices are apart
SAME_GAP = 0.02  # share: positions are rounded
OCCUPIED = 0.5  # share of a voxel, or probability, from which it is inside


def knows(data: bytes) -> bool:
    return data[128:132] == b"DICM"


def check_no_series(folder: Path) -> None:
    """Raise InputError where a path is a folder of DICOM files, with what would be right."""
    files = sorted(folder.glob("*"))[:FIRST_FILES] if folder.is_dir() else []
    if any(is_dicom(path) for path in files):
        raise InputError(
            f"{folder}: is a folder of DICOM files; a segmentation (SEG) is one of them: name it. Slices of "
            f"CT or MR are not a segmentation: {SEGMENT_FIRST}"
        )


def is_dicom(path: Path) -> bool:
    """Return whether a path is a file of DICOM, by its mark."""
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            return knows(file.read(132))
    except OSError:
        return False


def read_dicom(path: Path, data: bytes) -> Image:
    """Read a segmentation: its segments are labels by their numbers and parts by their names, in layers where
    they overlap. Voxels lie where the functional groups of its frames say, in LPS.

    Raises InputError for any other DICOM file, and where highdicom is not installed.
    """
    try:
        import highdicom
        import pydicom
    except ImportError:
        raise InputError(
            f"{path}: is DICOM: to read a segmentation (SEG) install highdicom, pip install 'o3dls[dicom]'; "
            f"if it is an image, {SEGMENT_FIRST}"
        ) from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pydicom warns of values that are longer or odder than DICOM allows
        try:
            _check_deflated(path, data)
            dataset = pydicom.dcmread(BytesIO(data))
            _check_kind(path, dataset)
            _check_packing(path, dataset)
            _check_end(path, dataset, data)
            _check_spacing(path, dataset)
            return _image_of_segments(path, highdicom.seg.Segmentation.from_dataset(dataset, copy=False))
        except InputError:
            raise
        except Exception as error:  # on a damaged file both raise errors of any class
            sentence = " ".join(str(error).split())[:200]
            raise InputError(
                f"{path}: cannot be read as a DICOM segmentation: {type(error).__name__}: {sentence}"
            ) from None


def _check_deflated(path: Path, data: bytes) -> None:
    """Raise InputError where a data set that is packed as a whole, which pydicom unpacks without a limit, is
    damaged, has no end, or is too large. It has no checksum.
    """
    if DEFLATED not in data[132 : 132 + LONGEST_META]:
        return
    begins = 144 + int.from_bytes(data[140:144], "little") if data[132:140] == GROUP_LENGTH else len(data)
    packer, left = zlib.decompressobj(wbits=-15), MOST_BYTES
    for at in range(begins, len(data), PIECE):
        left -= len(packer.decompress(data[at : at + PIECE], left + 1))
        if packer.eof or left < 0:
            break
    if not packer.eof:
        raise InputError(
            f"{path}: its packed data set has no end within {MOST_BYTES} bytes: is damaged, or too large"
        )


def _check_kind(path: Path, header: Any) -> None:
    if (kind := str(header.get("SOPClassUID", ""))) in SEGMENTATIONS:
        return
    name, modality = getattr(header.get("SOPClassUID"), "name", kind), header.get("Modality", "none")
    raise InputError(
        f"{path}: is DICOM of modality {modality} ({name}), and no segmentation (SEG): {SEGMENT_FIRST}"
    )


def _check_packing(path: Path, dataset: Any) -> None:
    """Raise InputError where pydicom has no decoder for how the voxels are packed."""
    from pydicom import __version__
    from pydicom.pixels import get_decoder

    syntax = dataset.file_meta.TransferSyntaxUID
    if syntax in PLAIN:
        return
    try:
        known = get_decoder(syntax).is_available
    except NotImplementedError:
        known = False
    if not known:
        raise InputError(
            f"{path}: its voxels are packed by {syntax.name} ({syntax}), which pydicom {__version__} does "
            "not unpack; save it without compression, as by dcmconv or gdcmconv --raw"
        )


def _check_end(path: Path, dataset: Any, data: bytes) -> None:
    """Raise InputError where bytes follow the voxels that do not belong there: some within are too many, and
    the voxels behind them shifted.
    """
    voxels = dataset.get_item(PIXELS)
    syntax = dataset.file_meta.TransferSyntaxUID
    if voxels is None or syntax.is_compressed or syntax.is_deflated:
        return
    end = voxels.value_tell + voxels.length
    if end < len(data) and data[end : end + 4] not in MAY_FOLLOW:
        raise InputError(
            f"{path}: {len(data) - end} bytes follow its voxels that do not belong there: is damaged"
        )


def _check_spacing(path: Path, dataset: Any) -> None:
    """Raise InputError where frames at equal distances lie at others than the header says: with half of it
    every second slice would count as missing.
    """
    shared, each = dataset.SharedFunctionalGroupsSequence[0], dataset.PerFrameFunctionalGroupsSequence
    stated = shared.get("PixelMeasuresSequence", [{}])[0].get("SpacingBetweenSlices")
    orientation = shared.get("PlaneOrientationSequence")
    if not stated or not orientation:
        return
    axes = np.asarray(orientation[0].ImageOrientationPatient, dtype=np.float64).reshape(2, 3)
    places = np.array([one.PlanePositionSequence[0].ImagePositionPatient for one in each], dtype=np.float64)
    gaps = np.diff(np.unique((places @ np.cross(*axes)).round(2)))
    if len(gaps) < FEWEST_GAPS or np.ptp(gaps) > SAME_GAP * gaps.min():
        return
    if abs(gaps.mean() - abs(float(stated))) > SAME_GAP * gaps.mean():
        raise InputError(
            f"{path}: says that its slices are {float(stated):g} mm apart (SpacingBetweenSlices), and its "
            f"frames lie {gaps.mean():.4g} mm apart (ImagePositionPatient): correct the one that is wrong"
        )


def _image_of_segments(path: Path, segmentation: Any) -> Image:
    geometry = segmentation.get_volume_geometry()
    if geometry is None:
        raise InputError(
            f"{path}: its frames are not parallel slices at equal distances: resample it, as in 3D Slicer"
        )
    count(path, [int(n) for n in geometry.spatial_shape])
    numbers = [int(number) for number in segmentation.segment_numbers]
    values, layers = _label_values(path, segmentation, numbers)
    names = [str(segmentation.get_segment_description(number).segment_label).strip() for number in numbers]
    notes: dict[str, str] = {}
    for k, (number, name) in enumerate(zip(numbers, names, strict=True)):
        own = name if names.count(name) == 1 else f"{name} ({number})"
        notes |= {
            f"Segment{k}_Name": own,
            f"Segment{k}_LabelValue": str(number),
            f"Segment{k}_Layer": str(layers[k]),
        }
    # highdicom counts slice, row, column
    affine = np.asarray(geometry.affine, dtype=np.float64)[:, [2, 1, 0, 3]]
    # frames without a segment are not stored: before the first and after the last is outside, not the border
    values = np.pad(values, [(1, 1), *[(0, 0)] * (values.ndim - 1)])
    affine[:3, 3] -= affine[:3, 2]
    return Image(values, check_affine(str(path), affine), "LPS", notes)


def _label_values(path: Path, segmentation: Any, numbers: list[int]) -> tuple[NDArray[Any], list[int]]:
    """Return the numbers of the segments (nz, ny, nx), or (nz, ny, nx, layers) where they overlap; the layer
    of each.
    """
    kind = segmentation.segmentation_type.value
    if kind != "FRACTIONAL":
        try:
            return segmentation.get_volume(combine_segments=True).array, [0] * len(numbers)
        except RuntimeError:  # highdicom does not combine segments that overlap
            pass
    shape = [int(n) for n in segmentation.get_volume_geometry().spatial_shape]
    count(path, [*shape, len(numbers)])
    inside = segmentation.get_volume().array >= OCCUPIED
    return inside * np.array(numbers, dtype=np.uint16), list(range(len(numbers)))
