"""Data arrays of VTK's XML files: where their bytes stand and how they are packed."""

from __future__ import annotations

import base64
import binascii
import lzma
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import InputError
from ..text import flat_numbers, is_count, typed

TYPES = {
    f"{sign}Int{bits}": f"{'u' if sign else 'i'}{bits // 8}" for sign in ("", "U") for bits in (8, 16, 32, 64)
}
TYPES |= {"Float32": "f4", "Float64": "f8"}
LONGEST_TEXT = 10_000
LZ4 = "vtkLZ4DataCompressor"
LZ4_RATIO = 255  # the most that its blocks can grow, so a wrong size takes no memory


def _unpack_lz4(packed: bytes, size: int) -> bytes:
    """Return a block of LZ4, of `size` bytes at most. Raises ValueError where it is damaged."""
    from lz4 import block

    try:
        room = max(min(size, LZ4_RATIO * len(packed)), 0)
        return bytes(block.decompress(packed, uncompressed_size=room))
    except block.LZ4BlockError as error:
        raise ValueError(str(error)) from None


def _unpack_zlib(packed: bytes, size: int) -> bytes:
    packer = zlib.decompressobj()
    return _check_whole(packer.decompress(packed, size + 1), packer.eof, size)


def _unpack_lzma(packed: bytes, size: int) -> bytes:
    packer = lzma.LZMADecompressor()
    return _check_whole(packer.decompress(packed, size + 1), packer.eof, size)


def _check_whole(unpacked: bytes, ended: bool, size: int) -> bytes:
    """Return the bytes unchanged. Raises ValueError where they are too many, or the end, and the checksum
    with it, was not reached.
    """
    if len(unpacked) > size or not ended:
        raise ValueError(f"its packed data do not end after {size} bytes")
    return unpacked


# each unpacks a block of `size` bytes at most
UNPACK: dict[str, Callable[[bytes, int], bytes]] = {
    "vtkZLibDataCompressor": _unpack_zlib,
    LZ4: _unpack_lz4,
    "vtkLZMADataCompressor": _unpack_lzma,
}


def open_xml(path: Path, data: bytes) -> tuple[ElementTree.Element, bytes]:
    """Return the XML tree, and the raw bytes of <AppendedData>, which are cut out first since they are no
    XML.
    """
    start = re.search(rb"<AppendedData[^>]*>\s*_", data)
    appended = b""
    if start:
        end = data.rfind(b"</AppendedData>")
        end = len(data) if end < start.end() else end
        appended = data[start.end() : end]
        data = data[: start.end() - 1] + data[end:]
    try:
        return ElementTree.fromstring(data), appended
    except ElementTree.ParseError as error:
        raise InputError(
            f"{path}: is not well-formed XML: {error}; the file is truncated or damaged"
        ) from None


@dataclass(frozen=True)
class Arrays:
    """This class reads data arrays by the conventions that the file's root states."""

    path: Path
    size: int
    order: str
    head: np.dtype[Any]
    compressor: str | None
    appended: bytes
    in_base64: bool

    @classmethod
    def of(cls, path: Path, root: ElementTree.Element, appended: bytes) -> Arrays:
        compressor = root.get("compressor")
        if compressor and compressor not in UNPACK:
            raise InputError(
                f"{path}: is packed by {compressor}: must be zlib, lz4, lzma or unpacked; save it with "
                "another compressor"
            )
        if compressor == LZ4 and find_spec("lz4") is None:
            raise InputError(
                f"{path}: is packed by LZ4, which needs a package: pip install lz4, or save it with zlib"
            )
        order = ">" if root.get("byte_order") == "BigEndian" else "<"
        head = np.dtype(order + TYPES.get(root.get("header_type", "UInt32"), "u4"))
        data = root.find("AppendedData")
        in_base64 = data is not None and data.get("encoding") == "base64"
        return cls(path, 1 << 32, order, head, compressor, appended, in_base64)

    def count(self, piece: ElementTree.Element, name: str) -> int:
        text = piece.get(name, "0").strip()
        if not is_count(text) or int(text) > self.size:
            raise InputError(f"{self.path}: {name}='{text[:20]}' is not a count")
        return int(text)

    def text(self, root: ElementTree.Element, name: str) -> str | None:
        """Return a string of the field data, stored as character codes that end with 0; None where there is
        none.
        """
        array = root.find(f"*/FieldData/*[@Name='{name}']")
        if array is None:
            return None
        if array.get("format") == "ascii":
            codes = bytes(
                int(word) for word in (array.text or "").split() if is_count(word) and int(word) < 128
            )
        else:
            codes = self._read_bytes(array, LONGEST_TEXT)
        return codes.split(b"\0")[0].decode("utf-8", errors="replace")

    def tuples(self, array: ElementTree.Element, n: int) -> NDArray[Any]:
        """Return values per point or cell, (n,) or (n, k); int64 where they are of an integer type."""
        width = self.count(array, "NumberOfComponents") or 1
        values = typed(self.numbers(array, n * width), TYPES.get(array.get("type", ""), "f8"))
        return values if width == 1 else values.reshape(n, width)

    def numbers(self, array: ElementTree.Element, count: int) -> Array:
        """Return the `count` numbers of an array. Raises InputError where it holds another number of them."""
        where = f"{self.path}: array '{array.get('Name', '')}'"
        kind = array.get("type", "")
        if kind not in TYPES:
            raise InputError(f"{where} is of type '{kind}': must be one of {', '.join(TYPES)}")
        if array.get("format") == "ascii":
            return flat_numbers(array.text or "", count, where)
        dtype = np.dtype(self.order + TYPES[kind])
        data = self._read_bytes(array, count * dtype.itemsize)
        if len(data) != count * dtype.itemsize:
            raise InputError(
                f"{where} has {len(data)} bytes: {count} values of {kind} need {count * dtype.itemsize}"
            )
        return np.frombuffer(data, dtype).astype(np.float64)

    def _read_bytes(self, array: ElementTree.Element, limit: int) -> bytes:
        """Read unpacked bytes of an array that is not ascii, little more than `limit` of them at most."""
        where = f"{self.path}: array '{array.get('Name', '')}'"
        match array.get("format"):
            case "binary":
                return self._read_block(
                    (array.text or "").strip().encode("ascii", "replace"), True, where, limit
                )
            case "appended":
                return self._read_block(
                    self.appended[self.count(array, "offset") :], self.in_base64, where, limit
                )
            case other:
                raise InputError(f"{where} has format '{other}': must be ascii, binary or appended")

    def _read_block(self, data: bytes, in_base64: bool, where: str, limit: int) -> bytes:
        """Read unpacked bytes of one array: a header of sizes, then the data."""
        try:
            if self.compressor:
                return self._unpack_blocks(data, in_base64, where, limit)
            size = int(self._read_head(data, 1, in_base64)[0])
            first = self.head.itemsize
            last = self.head.itemsize + size
            return (_decode_base64(data, last)[first:] if in_base64 else data[first:last])[:size]
        except (binascii.Error, zlib.error, lzma.LZMAError, ValueError) as error:
            raise InputError(f"{where} is damaged: {error}") from None

    def _read_head(self, data: bytes, n: int, in_base64: bool) -> NDArray[Any]:
        size = n * self.head.itemsize
        raw = _decode_base64(data, size) if in_base64 else data[:size]
        return np.frombuffer(raw[:size], self.head, n)

    def _unpack_blocks(self, data: bytes, in_base64: bool, where: str, limit: int) -> bytes:
        blocks = int(self._read_head(data, 1, in_base64)[0])
        if blocks > len(data):
            raise InputError(f"{where} declares {blocks} packed blocks in {len(data)} bytes")
        head = self._read_head(data, 3 + blocks, in_base64).astype(np.int64)
        start = (3 + blocks) * self.head.itemsize
        start = -(-start // 3) * 4 if in_base64 else start  # the header is encoded on its own
        packed = _decode_base64(data[start:], int(head[3:].sum())) if in_base64 else data[start:]
        unpacked = []
        at = 0
        for k, size in enumerate(head[3:].tolist()):
            full = int(head[2]) if k == blocks - 1 and head[2] else int(head[1])
            # more than the array can hold is a wrong count, or a bomb
            unpacked.append(UNPACK[self.compressor or ""](packed[at : at + size], min(full, limit)))
            at += size
            limit -= len(unpacked[-1])
        return b"".join(unpacked)


def _decode_base64(text: bytes, size: int) -> bytes:
    """Return at least the first `size` bytes of base64 text, which may go on with something else."""
    return base64.b64decode(text[: -(-size // 3) * 4], validate=True)
