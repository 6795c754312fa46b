"""NIfTI-1 volumes as they are read; RAS by definition, brought to LPS."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ...geometry.similarity import TURN
from .voxels import LARGEST, Image, inflate, shaped, size_of

TYPES = {
    2: "u1",
    4: "i2",
    8: "i4",
    16: "f4",
    64: "f8",
    256: "i1",
    512: "u2",
    768: "u4",
    1024: "i8",
    1280: "u8",
}
SAME_SIZE = 0.01  # of a voxel's size: headers are rounded
UNITS = {0: 1.0, 1: 1000.0, 2: 1.0, 3: 0.001}


def knows(data: bytes) -> bool:
    return _header(data) is not None


def _header(data: bytes) -> bytes | None:
    """The 348 bytes of a NIfTI-1 header, gzipped or not; None for other files."""
    if data[:2] == b"\x1f\x8b":
        try:
            data = zlib.decompressobj(wbits=31).decompress(data[:20_000], 352)
        except zlib.error:
            return None
    return data[:348] if data[344:348] in (b"n+1\0", b"ni1\0") else None


def read_nifti(path: Path, data: bytes) -> Image:
    header = _header(data)
    if header is None or header[344:348] != b"n+1\0":
        raise InputError(f"{path}: must be NIfTI-1 in one file (.nii or .nii.gz)")
    order = "<" if header[:4] == (348).to_bytes(4, "little") else ">"
    dim = np.frombuffer(header, order + "i2", 8, 40).tolist()
    (kind,) = np.frombuffer(header, order + "i2", 1, 70).tolist()
    offset, slope, shift = np.frombuffer(header, order + "f4", 3, 108).astype(float).tolist()
    if not 3 <= dim[0] <= 7 or any(n > 1 for n in dim[4 : dim[0] + 1]):
        raise InputError(f"{path}: has {dim[0]} axes of {dim[1:]}: must be one volume in 3D")
    if kind not in TYPES or not 348 <= offset < 1e6:
        raise InputError(f"{path}: has data type {kind} at byte {offset}: must be one of {sorted(TYPES)}")
    size = size_of(path, dim[1:4], TYPES[kind])
    raw = inflate(path, data, int(offset) + size) if data[:2] == b"\x1f\x8b" else data
    values = shaped(path, raw[int(offset) :], order + TYPES[kind], dim[1:4])
    if np.isfinite([slope, shift]).all() and slope != 0 and (slope, shift) != (1.0, 0.0):
        values = values * slope + shift
    factor = UNITS.get(header[123] & 7, 1.0)
    return Image(values, TURN @ np.diag([factor, factor, factor, 1.0]) @ _affine(path, header, order))


def _affine(path: Path, header: bytes, order: str) -> Array:
    """Index to RAS: the sform if there is one, else the qform."""
    qform, sform = np.frombuffer(header, order + "i2", 2, 252).tolist()
    affine = np.eye(4)
    if sform > 0:
        affine[:3] = np.frombuffer(header, order + "f4", 12, 280).reshape(3, 4)
        _agree(path, affine, np.frombuffer(header, order + "f4", 3, 80).astype(float))
    elif qform > 0:
        pixdim = np.frombuffer(header, order + "f4", 4, 76).astype(float)
        b, c, d, *origin = np.frombuffer(header, order + "f4", 6, 256).astype(float).tolist()
        if not np.isfinite([b, c, d]).all() or b * b + c * c + d * d > 1.0001:
            raise InputError(f"{path}: its qform is no rotation: {b}, {c}, {d}")
        affine[:3, :3] = _rotation(b, c, d) * [*pixdim[1:3], pixdim[3] * (-1.0 if pixdim[0] < 0 else 1.0)]
        affine[:3, 3] = origin
    else:
        raise InputError(
            f"{path}: its header has neither qform nor sform, so it does not say how it lies in space; "
            "set one first"
        )
    if not (np.abs(affine) < LARGEST).all():
        raise InputError(f"{path}: its axes and origin must be finite and below {LARGEST:g}")
    return affine


def _agree(path: Path, affine: Array, pixdim: Array) -> None:
    """Refuse a sform whose voxels have other sizes than the header's pixdim (3,): one of them is wrong, or
    the sform leads to another body, as to a standard brain.
    """
    sizes = np.linalg.norm(affine[:3, :3], axis=0)
    said = np.abs(pixdim)
    stated = np.isfinite(said) & (said > 0.0)
    if (np.abs(sizes - said)[stated] > SAME_SIZE * said[stated]).any():
        ours, theirs = (" x ".join(f"{size:.4g}" for size in three) for three in (sizes, said))
        raise InputError(
            f"{path}: its sform has voxels of {ours}, its pixdim of {theirs}: make them agree, with the "
            "sizes that the scanner had"
        )


def _rotation(b: float, c: float, d: float) -> Array:
    """The rotation of a unit quaternion whose real part is not stored."""
    a = np.sqrt(max(1.0 - b * b - c * c - d * d, 0.0))
    return np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ]
    )
