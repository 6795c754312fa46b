"""MetaImage volumes (.mha, .mhd) as they are read; in LPS."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError
from ..text import integers, is_count, number_rows
from .layout import Layout
from .voxels import LARGEST, Image, beside, beside_path, inflate, shaped, size_of

TYPES = {
    "CHAR": "i1",
    "UCHAR": "u1",
    "SHORT": "i2",
    "USHORT": "u2",
    "INT": "i4",
    "UINT": "u4",
    "LONG": "i4",
    "ULONG": "u4",
    "LONG_LONG": "i8",
    "ULONG_LONG": "u8",
    "FLOAT": "f4",
    "DOUBLE": "f8",
}


def knows(data: bytes) -> bool:
    return b"NDims" in data[:400]


def read_meta(path: Path, data: bytes) -> Image:
    """Read a MetaImage, with layers along a fourth axis or as channels: its matrix is in LPS, and its
    AnatomicalOrientation is not believed, since ITK writes one that means something else.
    """
    header, file, end = _read_header(path, data)
    kind = header["ElementType"].removeprefix("MET_")
    n, sizes = _read_sizes(path, header)
    need = size_of(path, sizes, TYPES[kind])
    body = _voxel_bytes(path, header, file, data[end:], need)
    if header.get("CompressedData", "").lower() == "true":
        body = bytes(inflate(path, body, need))
    values = shaped(
        path, body, _byte_order(header) + TYPES[kind], sizes
    )  # channels are the last axis now, a fourth axis is the first
    return Image(np.moveaxis(values, 0, -1) if n == 4 else values, _read_affine(path, header, n))


def layout(path: Path, data: bytes) -> Layout | None:
    """Return where the voxels of a grey image lie, by the first bytes of its file; None where it takes the
    whole file to tell. Raises InputError as `read_meta`.
    """
    header, file, end = _read_header(path, data)
    n, sizes = _read_sizes(path, header)
    binary = header.get("BinaryData", "True").lower() == "true" and header.get("HeaderSize", "0") == "0"
    if len(sizes) != 3 or not binary:
        return None
    where = path if file == "LOCAL" else beside_path(path, file)
    begin = end if file == "LOCAL" else 0
    packed = header.get("CompressedData", "").lower() == "true"
    offset, begin = (0, begin) if packed else (begin, 0)
    dtype = _byte_order(header) + TYPES[header["ElementType"].removeprefix("MET_")]
    affine = _read_affine(path, header, n)
    return Layout(where, offset, dtype, tuple(sizes), affine, "LPS", begin, packed=packed)


def _byte_order(header: Mapping[str, str]) -> str:
    """Return NumPy's sign of how the bytes of the voxels are ordered."""
    stated = (header.get(key, "").lower() for key in ("BinaryDataByteOrderMSB", "ElementByteOrderMSB"))
    return ">" if "true" in stated else "<"


def _read_header(path: Path, data: bytes) -> tuple[dict[str, str], str, int]:
    """Return the fields of the header, whose type of voxels is known, the name of the data file, and the byte
    behind them.
    """
    end = re.search(rb"^ElementDataFile\s*=\s*([^\r\n]+)\r?\n?", data[:100_000], re.MULTILINE)
    if end is None:
        raise InputError(f"{path}: MetaImage header has no line ElementDataFile; the file is truncated")
    pairs = (
        line.partition("=") for line in data[: end.start()].decode("utf-8", errors="replace").splitlines()
    )
    header = {key.strip(): value.strip() for key, _, value in pairs}
    kind = header.get("ElementType", "").removeprefix("MET_")
    if kind not in TYPES:
        raise InputError(f"{path}: has ElementType '{kind[:40]}': must be one of {', '.join(TYPES)}")
    return header, end[1].decode("utf-8", errors="replace").strip(), end.end()


def _read_sizes(path: Path, header: Mapping[str, str]) -> tuple[int, list[int]]:
    """Read the number of axes, and their sizes with that of several channels in front, as they stand in the
    file.
    """
    axes, channels = header.get("NDims", ""), header.get("ElementNumberOfChannels", "1")
    if axes not in ("3", "4") or not is_count(channels) or (axes == "4" and channels != "1"):
        raise InputError(
            f"{path}: has NDims = {axes[:20]} and {channels[:20]} channels: must be a volume in 3D, or "
            "several along a fourth axis or as channels"
        )
    sizes = _read_numbers(path, header, ("DimSize",), int(axes), None)
    whole = [int(size) if size == int(size) and abs(size) < 1e9 else -1 for size in sizes]
    return int(axes), whole if channels == "1" else [int(channels), *whole]


def _read_affine(path: Path, header: Mapping[str, str], n: int) -> Array:
    """Read the matrix from an index to LPS; a fourth axis must only be apart from those of space."""
    names = ("TransformMatrix", "Rotation", "Orientation")
    rows = _read_numbers(path, header, names, n * n, np.eye(n).ravel()).reshape(n, n)
    if rows[:3, 3:].any() or rows[3:, :3].any():
        raise InputError(
            f"{path}: the fourth axis of its TransformMatrix runs through space: must be time alone"
        )
    affine = np.eye(4)
    spacing = _read_numbers(path, header, ("ElementSpacing", "ElementSize"), n, np.ones(n))
    affine[:3, :3] = rows[:3, :3].T * spacing[:3]
    affine[:3, 3] = _read_numbers(path, header, ("Offset", "Position", "Origin"), n, np.zeros(n))[:3]
    return affine


def _voxel_bytes(path: Path, header: Mapping[str, str], file: str, local: bytes, need: int) -> bytes:
    """Return the bytes of the voxels: a data file may begin with a header of its own, and -1 says that the
    voxels are its last bytes.
    """
    if header.get("BinaryData", "True").lower() != "true":
        raise InputError(
            f"{path}: BinaryData = {header['BinaryData'][:20]}: must be True; save the voxels as binary"
        )
    size = int(
        integers(_read_numbers(path, header, ("HeaderSize",), 1, np.zeros(1)), f"{path}: HeaderSize")[0]
    )
    if size < -1 or (size > 0 and file == "LOCAL"):
        raise InputError(
            f"{path}: HeaderSize = {size}: must be -1 or 0, or above 0 where the voxels are in a file of "
            "their own"
        )
    body = local if file == "LOCAL" else beside(path, file)
    return body[-need:] if size == -1 else body[size:]


def _read_numbers(
    path: Path, header: Mapping[str, str], keys: tuple[str, ...], n: int, default: Array | None
) -> Array:
    key = next((key for key in keys if key in header), None)
    others = [
        other for other in keys if other in header and header[other].split() != header[str(key)].split()
    ]
    if others:
        raise InputError(
            f"{path}: {key} = {header[str(key)][:40]} and {others[0]} = {header[others[0]][:40]} contradict: "
            "leave the one that is right"
        )
    if key is None and default is not None:
        return default
    text = header.get(key or "", "-")
    values: Array = number_rows([text], n, path, [1], keys[0])[0]
    if not (np.abs(values) < LARGEST).all():
        raise InputError(f"{path}: {keys[0]} = {text[:60]}: must be finite and below {LARGEST:g}")
    return values
