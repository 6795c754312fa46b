"""Voxels with their place in space, and what the readers of image formats share."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import Answer, Doubt, InputError
from ..text import read_bytes

MOST_VOXELS = 1 << 28  # 1000 slices of 512 x 512: twice the largest CT of a heart
MOST_BYTES = 1 << 30  # bytes of the voxels, which are held in memory twice
PIECE = 1 << 16  # packed bytes unpacked at one time
MOST_PARTS = 1 << 17  # twice those of 1 GiB in blocks of 64 kB, as bgzip writes them
LARGEST = 1e6  # mm from the origin
MOST_COUNTED = 1 << 16  # values between the least and the greatest


@dataclass(frozen=True, eq=False)
class Image:
    """An image has values (nz, ny, nx), or (nz, ny, nx, layers), and their `affine`, which takes an index (i,
    j, k), the centre of a voxel, to mm.

    space is LPS, or unknown where the file does not say; notes are free `key = value` pairs, such as Slicer's
    segment names.
    """

    values: NDArray[Any]
    affine: Array
    space: str = "LPS"
    notes: Mapping[str, str] = field(default_factory=dict)

    @property
    def spacing(self) -> Array:
        """Distances of the voxels along i, j, k."""
        return np.asarray(np.linalg.norm(self.affine[:3, :3], axis=0))


def along_axes(where: str, fault: str, spacing: Array, frame: str | None) -> tuple[Array, str]:
    """Return the matrix from an index to mm where a file states the sizes of its voxels (3,) but not how its
    axes lie: along those of `frame`, from its origin on.

    Raises InputError with the `fault` where the frame is not said.
    """
    if frame not in ("LPS", "RAS"):
        raise Doubt(
            f"{where}: {fault}, so it does not say how its axes lie in the body",
            "look at it, and say "
            "--frame RAS where i, j and k run to the right, the front and the head, --frame LPS where they "
            "run to the left, the back and the head; else orient it first, as in 3D Slicer",
            [
                Answer("they run to the right, the front and the head", {"frame": "RAS"}),
                Answer("they run to the left, the back and the head", {"frame": "LPS"}),
            ],
        )
    return check_affine(where, np.diag([*spacing, 1.0])), frame


def check_affine(where: str, affine: Array) -> Array:
    """Return the affine unchanged. Raises InputError where it is not finite or leads far away."""
    if not (np.abs(affine) < LARGEST).all():
        raise InputError(f"{where}: its axes and origin must be finite and below {LARGEST:g}")
    return affine


def packed(data: bytes) -> bool:
    """Return whether the bytes are gzip's."""
    return data[:2] == b"\x1f\x8b"


def inflate(path: Path, data: bytes, most: int) -> bytearray:
    """Return gzip or zlib data, which may come in several parts, unpacked to their end, where their checksums
    and lengths are compared; only zeros may follow.

    Raises InputError where they are damaged or have no end, and where more than `most` bytes come out, of
    which no more is kept.
    """
    out, at = bytearray(), 0
    for _ in range(MOST_PARTS):
        if (
            at == len(data) or data[at] == 0
        ):  # no part begins with 0, with which blocks of tapes are filled up
            break
        at = _inflate_part(path, data, at, out, most)
        if len(out) > most:
            raise InputError(
                f"{path}: its packed data unpack to more than the {most} bytes that its header says: it "
                "is damaged"
            )
    if data[at:].strip(b"\0"):
        raise InputError(
            f"{path}: its packed data are damaged: byte {at} and those behind are no part of them"
        )
    return out


def _inflate_part(path: Path, data: bytes, at: int, out: bytearray, most: int) -> int:
    """Put what the part holds that begins at byte `at` behind what is out, which becomes one byte more than
    `most` at most, and return where it ends.

    zlib compares the checksum when it comes to the end, so the part is read until there.
    """
    packer = zlib.decompressobj(wbits=47)  # 47: gzip or zlib, as the head says
    try:
        while not packer.eof and at < len(data) and len(out) <= most:
            piece = data[at : at + PIECE]
            out += packer.decompress(piece, most + 1 - len(out))
            at += len(piece) - len(packer.unused_data)
    except zlib.error as error:
        raise InputError(f"{path}: its packed data are damaged: {error}") from None
    if not packer.eof and len(out) <= most:
        raise InputError(f"{path}: its packed data have no end: the file is truncated")
    return at


def shaped(path: Path, data: bytes | bytearray | memoryview, dtype: str, sizes: list[int]) -> NDArray[Any]:
    """Return an array whose first axis runs fastest in the file, with the axes turned around. Raises
    InputError where bytes are missing.
    """
    need = size_of(path, sizes, dtype)
    if len(data) < need:
        raise InputError(
            f"{path}: {sizes} values of {np.dtype(dtype).name} need {need} bytes, {len(data)} are there: "
            "the file is truncated"
        )
    return np.frombuffer(data, dtype, count(path, sizes)).reshape(sizes[::-1])


def count(path: Path, sizes: list[int]) -> int:
    """Return the number of values. Raises InputError for sizes that cannot be."""
    if not sizes or min(sizes) < 1 or float(np.prod([float(n) for n in sizes])) > MOST_VOXELS:
        raise InputError(
            f"{path}: has size {sizes}: must be positive, at most {MOST_VOXELS} values together; cut "
            "larger volumes to the heart, and save the phases of a cine one by one"
        )
    return int(np.prod(sizes))


def size_of(path: Path, sizes: list[int], dtype: str) -> int:
    """Return the number of bytes of the voxels, by what the header says. Raises InputError, before anything
    is unpacked, where they are too many.
    """
    size = count(path, sizes) * np.dtype(dtype).itemsize
    if size > MOST_BYTES:
        raise InputError(
            f"{path}: {sizes} values of {np.dtype(dtype).name} take {size} bytes: at most {MOST_BYTES}; "
            "save labels as whole numbers of 1 or 2 bytes, or cut the volume to the heart"
        )
    return size


def beside(path: Path, name: str) -> bytes:
    """Return the bytes of a data file in the same folder. Raises InputError for a path that leads
    elsewhere.
    """
    return read_bytes(beside_path(path, name))


def beside_path(path: Path, name: str) -> Path:
    """Return a data file in the same folder, by its name in a header. Raises InputError as `beside`."""
    name = name.removeprefix("./")
    if (
        Path(name).name != name
        or not name
        or "\0" in name
        or "%" in name
        or name == "LIST"
        or len(name.encode("utf-8", "replace")) > 255  # bytes: no file system has longer ones
    ):
        raise InputError(f"{path}: names its data '{name[:60]}': must be one file in the same folder")
    if not (path.parent / name).is_file():
        raise InputError(f"{path}: its data file '{name}' is not beside it")
    return path.parent / name


def whole_values(path: str, values: NDArray[Any]) -> set[int]:
    """Return the different values of a slice. Raises InputError where one is not a whole number."""
    if values.dtype.kind in "iu":
        low, high = int(values.min()), int(values.max())
        if high - low < MOST_COUNTED:  # counting takes a tenth of the time of sorting
            above = values.astype(np.int64)
            above -= above.min()
            return {low + int(k) for k in np.flatnonzero(np.bincount(above.ravel()))}
    found = np.unique(values)
    if found.dtype.kind == "f" and not ((found == np.round(found)) & (np.abs(found) < 1e9)).all():
        raise InputError(
            f"{path}: holds values that are not whole numbers; it is an image, not a label volume"
        )
    return {int(value) for value in found}
