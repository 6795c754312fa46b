"""Where the voxels of a volume lie in its file, so that slices of it are read without the rest."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import InputError
from .voxels import PIECE, packed

Grey = NDArray[np.float32]
Window = tuple[slice, slice]  # rows and columns of a slice
WHOLE: Window = (slice(None), slice(None))


class Volume(Protocol):
    """A volume lies at its `affine`, from an index (i, j, k) to mm in the frame `space`, and gives slices of
    its voxels.
    """

    @property
    def shape(self) -> tuple[int, int, int]: ...
    @property
    def affine(self) -> Array: ...
    @property
    def space(self) -> str: ...
    def check(self) -> None: ...
    def slab(self, low: int, high: int, window: Window = WHOLE) -> Grey: ...


@dataclass(frozen=True, eq=False)
class Layout:
    """A layout says where voxels of a `dtype` and of `sizes` lie, the first axis running fastest: from byte
    `offset` on, of the file or, where it is packed (gzip or zlib) from byte `begin` on, of what unpacks.

    `affine` takes an index (i, j, k) to mm in the frame `space`; a value is `scaling[0]` times the stored one
    plus `scaling[1]`. packed: None where the first bytes tell.
    """

    path: Path
    offset: int
    dtype: str
    sizes: tuple[int, ...]
    affine: Array
    space: str
    begin: int = 0
    scaling: tuple[float, float] = (1.0, 0.0)
    packed: bool | None = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels along i, j, k."""
        i, j, k = self.sizes
        return i, j, k

    def check(self) -> None:
        """Raise InputError where the voxels are not whole: bytes are missing, or packed ones are damaged."""
        self._bytes_of(self.sizes[2], self.sizes[2])

    def slab(self, low: int, high: int, window: Window = WHOLE) -> Grey:
        """Read the window of the slices from `low` on, before `high`, (high - low, nj, ni)."""
        data = self._bytes_of(low, high)
        stored = np.frombuffer(data, self.dtype).reshape(high - low, self.sizes[1], self.sizes[0])
        values = stored[(slice(None), *window)].astype(np.float32)
        if self.scaling != (1.0, 0.0):
            values = values * np.float32(self.scaling[0]) + np.float32(self.scaling[1])
        return np.asarray(values, dtype=np.float32)

    def _bytes_of(self, low: int, high: int) -> bytes | bytearray:
        """Return the bytes of slices; unpacked up to their end, and to the very end where none are asked
        for.
        """
        each = self.sizes[0] * self.sizes[1] * np.dtype(self.dtype).itemsize
        start, stop = self.offset + low * each, self.offset + high * each
        whole = self.offset + self.sizes[2] * each
        try:
            with self.path.open("rb") as file:
                file.seek(self.begin)
                is_packed = packed(file.read(2)) if self.packed is None else self.packed
                file.seek(self.begin)
                if is_packed:
                    return self._unpack_range(file, start, stop, whole)
                there = file.seek(0, 2)
                if there < whole:
                    raise self._truncated(there - self.offset, whole - self.offset)
                file.seek(start)
                return bytes(file.read(stop - start))
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror}") from error

    def _unpack_range(self, file: Any, start: int, stop: int, whole: int) -> bytearray:
        """Return bytes `start` to `stop` of what unpacks; at the end of the last slice all of it is unpacked,
        where its checksum is compared.
        """
        out, at = bytearray(), 0
        for piece in _unpacked(self.path, file):
            out += piece[max(start - at, 0) : max(stop - at, 0)]
            at += len(piece)
            if at > whole:
                raise InputError(
                    f"{self.path}: its packed data unpack to more than the {whole} bytes that its header "
                    "says: it is damaged"
                )
            if at >= stop and stop < whole:
                return out
        if at < whole:
            raise self._truncated(at - self.offset, whole - self.offset)
        return out

    def _truncated(self, there: int, need: int) -> InputError:
        return InputError(
            f"{self.path}: {list(self.sizes)} values of {np.dtype(self.dtype).name} need {need} bytes, "
            f"{max(there, 0)} are there: the file is truncated"
        )


def _unpacked(path: Path, file: Any) -> Iterator[bytes]:
    """Yield what unpacks of a file that is packed in one part or several; zeros may follow. Raises InputError
    where it is damaged.
    """
    packer = zlib.decompressobj(wbits=47)  # 47: gzip or zlib, as the head says
    fresh = True
    while data := file.read(PIECE):
        while data:
            if fresh and not data.strip(b"\0"):
                break
            try:
                piece = packer.decompress(data, 16 * PIECE)  # a byte may unpack to a thousand
            except zlib.error as error:
                raise InputError(f"{path}: its packed data are damaged: {error}") from None
            data, fresh = packer.unconsumed_tail or packer.unused_data, packer.eof
            if fresh:
                packer = zlib.decompressobj(wbits=47)
            yield piece
    while not fresh and (piece := packer.decompress(b"", 16 * PIECE)):  # what the last bytes still hold
        fresh = packer.eof
        yield piece
    if not fresh:
        raise InputError(f"{path}: its packed data have no end: the file is truncated")
