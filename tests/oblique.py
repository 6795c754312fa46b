"""An oblique image with anisotropic voxels about the origin, in LPS, written in each format that is read."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from o3dls.arrays import Array
from o3dls.geometry.similarity import TURN, apply
from o3dls.io.images.volumes import write_volume

SPACING = np.array([0.9, 1.3, 2.2])  # mm, along i, j, k
SHAPE = (110, 80, 50)
SEED = 90_417
FORMATS = ("lps.nrrd", "ras.nrrd", "image.nii", "image.nii.gz", "image.mha", "packed.mha", "series")


def affine() -> Array:
    """Takes an index to LPS; the middle of the volume is at (4, -3, 2)."""
    axes = np.linalg.qr(np.random.default_rng(SEED).normal(size=(3, 3)))[0]
    axes = axes * np.sign(np.linalg.det(axes))
    matrix = np.eye(4)
    matrix[:3, :3] = axes * SPACING
    matrix[:3, 3] = np.array([4.0, -3.0, 2.0]) - matrix[:3, :3] @ ((np.array(SHAPE) - 1) / 2)
    return matrix


def places() -> Array:
    """Centres (ni, nj, nk, 3) of the voxels, in LPS."""
    return apply(affine(), np.stack(np.indices(SHAPE), axis=-1))


def ball_image(radius: float = 20.0) -> Array:
    """Signed distance (ni, nj, nk) to a ball about the origin, a thousand times as large."""
    return np.asarray(1000.0 * (np.linalg.norm(places(), axis=-1) - radius))


def write(folder: Path, name: str, values: Array, matrix: Array | None = None) -> Path:
    """The image at `matrix`, in LPS, as the file or the folder of that name."""
    lps = affine() if matrix is None else matrix
    path = folder / name
    if name == "series":
        write_series(path, values, lps)
    elif name.endswith(".mha"):
        path.write_bytes(meta(values, lps, packed=name.startswith("packed")))
    elif name.startswith("ras"):
        write_volume(path, values, TURN @ lps, space="RAS")
    else:
        write_volume(path, values, lps, space="LPS")
    return path


def meta(values: Array, lps: Array, *, packed: bool = False) -> bytes:
    spacing = np.linalg.norm(lps[:3, :3], axis=0)
    rows = (lps[:3, :3] / spacing).T.ravel()
    body = np.asarray(values, dtype="<f4").tobytes(order="F")
    lines = {
        "ObjectType": "Image",
        "NDims": "3",
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "CompressedData": str(packed),
        "TransformMatrix": " ".join(map(repr, rows.tolist())),
        "Offset": " ".join(map(repr, lps[:3, 3].tolist())),
        "ElementSpacing": " ".join(map(repr, spacing.tolist())),
        "DimSize": " ".join(map(str, values.shape)),
        "ElementType": "MET_FLOAT",
        "ElementDataFile": "LOCAL",
    }
    head = "".join(f"{key} = {value}\n" for key, value in lines.items())
    return head.encode() + (zlib.compress(body) if packed else body)


def write_series(
    folder: Path, values: Array, lps: Array, change: Callable[[int, object], None] | None = None
) -> None:
    """Slices of an MR series, in files whose names are in no order; `change` may spoil each."""
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, MRImageStorage, generate_uid

    folder.mkdir()
    series, spacing = generate_uid(), np.linalg.norm(lps[:3, :3], axis=0)
    axes = lps[:3, :3] / spacing
    low, slope = float(values.min()), float(np.ptp(values)) / 65_000 or 1.0
    stored = np.round((values - low) / slope).astype("<u2")
    for k in range(values.shape[2]):
        image = Dataset()
        image.file_meta = FileMetaDataset()
        image.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        image.SOPClassUID = image.file_meta.MediaStorageSOPClassUID = MRImageStorage
        image.SOPInstanceUID = image.file_meta.MediaStorageSOPInstanceUID = generate_uid()
        image.SeriesInstanceUID, image.SeriesDescription, image.Modality = series, "LGE", "MR"
        image.Rows, image.Columns, image.SamplesPerPixel = values.shape[1], values.shape[0], 1
        image.PixelSpacing = [float(spacing[1]), float(spacing[0])]
        image.ImageOrientationPatient = [float(v) for v in (*axes[:, 0], *axes[:, 1])]
        image.ImagePositionPatient = [float(v) for v in lps[:3, 3] + lps[:3, 2] * k]
        image.PhotometricInterpretation, image.PixelRepresentation = "MONOCHROME2", 0
        image.BitsAllocated, image.BitsStored, image.HighBit = 16, 16, 15
        image.RescaleSlope, image.RescaleIntercept = f"{slope:.10g}", f"{low:.10g}"
        image.PixelData = np.ascontiguousarray(stored[:, :, k].T).tobytes()
        if change is not None:
            change(k, image)
        image.save_as(folder / f"{(k * 7) % 1000:03d}_{k}.dcm", enforce_file_format=True)
