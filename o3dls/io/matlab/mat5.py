"""MATLAB version 5 files. An own reader, since scipy's crashes the process on damaged ones."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
TEXT = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
MATRIX, PACKED = 14, 15
CELL, STRUCT, OBJECT, CHAR, OPAQUE = 1, 2, 3, 4, 17
NUMERIC = range(6, 16)
DEEPEST = 40
PADDING = 8  # elements are filled up to a multiple of so many bytes
LARGEST = 1 << 30  # bytes of a variable, which is held in memory more than once


@dataclass(frozen=True)
class Opaque:
    """An opaque element is an object of a MATLAB class (string, datetime, TriRep), whose data have no
    documented layout.
    """

    of: str


@dataclass
class Elements:
    """This reads a run of elements, each of which has a type, a size and its bytes. Every error names the
    file and the byte in the (unpacked) run.
    """

    path: Path
    data: bytes
    order: str
    at: int = 0
    depth: int = 0

    def error(self, text: str) -> InputError:
        return InputError(f"{self.path}: byte {self.at}: {text}; the MATLAB file is truncated or damaged")

    @property
    def left(self) -> bool:
        return self.at + 8 <= len(self.data)

    def take(self) -> tuple[int, bytes]:
        """Return the type and the bytes of the next element; those of a short one stand in the tag itself."""
        if not self.left:
            raise self.error("an element is missing")
        kind, size = np.frombuffer(self.data, self.order + "u4", 2, self.at).tolist()
        start = self.at + 8
        if kind >> 16:
            kind, size, start = kind & 0xFFFF, kind >> 16, self.at + 4
        if start + size > len(self.data) or (start == self.at + 4 and size > 4):
            raise self.error(f"an element of {size} bytes does not fit into {len(self.data) - self.at}")
        body = self.data[start : start + size]
        self.at = (
            start + size
            if kind == PACKED
            else self.at + 8
            if start == self.at + 4
            else start + -(-size // 8) * 8
        )
        return kind, body

    def inside(self, body: bytes) -> Elements:
        if self.depth >= DEEPEST:
            raise self.error(f"arrays are nested more than {DEEPEST} deep")
        return Elements(self.path, body, self.order, 0, self.depth + 1)

    def numbers(self) -> NDArray[Any]:
        kind, body = self.take()
        if kind not in NUMBERS or len(body) % np.dtype(NUMBERS[kind]).itemsize:
            raise self.error(f"an element of type {kind} and {len(body)} bytes is not an array of numbers")
        return np.frombuffer(body, self.order + NUMBERS[kind])

    def text(self) -> str:
        kind, body = self.take()
        if kind not in TEXT:
            raise self.error(f"an element of type {kind} is not text")
        wide = TEXT[kind] in ("utf-16", "utf-32")
        return body.decode(TEXT[kind] + ("-be" if self.order == ">" else "-le") * wide, errors="replace")


def _unpack_element(run: Elements, packed: bytes) -> bytes:
    """Unpack a packed element to the length that it states. Raises InputError where that is too long, or
    where the packed data, at whose end their checksum is, do not end there.
    """
    packer = zlib.decompressobj()
    try:
        tag = packer.decompress(packed, 8)
        size = int.from_bytes(tag[4:], "little" if run.order == "<" else "big")
        if size > LARGEST:
            raise run.error(f"a variable unpacks to {size} bytes: at most {LARGEST}")
        body = packer.decompress(packer.unconsumed_tail, size + PADDING)
    except zlib.error as error:
        raise run.error(f"packed data are broken: {error}") from None
    if not packer.eof:
        raise run.error(f"packed data do not end after the {size} bytes that they say")
    return tag + body


def read_mat5(path: Path, data: bytes) -> dict[str, Any]:
    """Read the variables by name: structs as dictionaries, arrays of structs and cells as lists, numbers
    without axes of one. Raises InputError.
    """
    if data[126:128] not in (b"IM", b"MI"):
        raise InputError(f"{path}: MATLAB header of 128 bytes does not end in IM or MI; the file is damaged")
    run = Elements(path, data[128:], "<" if data[126:128] == b"IM" else ">")
    variables: dict[str, Any] = {}
    while run.left:
        kind, body = run.take()
        if kind == PACKED:
            kind, body = run.inside(_unpack_element(run, body)).take()
        if kind != MATRIX:
            raise run.error(f"a variable of type {kind} is not an array")
        name, value = _read_array(run.inside(body))
        if name in variables:
            raise run.error(f"variable '{name}' appears twice")
        variables[name] = value
    if len(run.data) - run.at > 0:
        raise run.error("the last element is incomplete")
    return variables


def _read_array(run: Elements) -> tuple[str, Any]:
    """Read the name and value of one array; None for kinds that OpenEP does not use (sparse, functions)."""
    if not run.left:
        return "", np.zeros(0)
    flags = run.numbers()
    if len(flags) and int(flags[0]) & 0xFF == OPAQUE:  # an opaque array has no dimensions
        name, _, of = run.text(), run.text(), run.text()
        return name, Opaque(of)
    dims = run.numbers().astype(np.int64)
    name = run.text()
    if len(flags) == 0 or len(dims) < 2 or dims.min() < 0 or float(np.prod(dims.astype(float))) > LARGEST:
        raise run.error(f"array '{name[:40]}' has dimensions {dims.tolist()[:8]}")
    kind = int(flags[0]) & 0xFF
    count = int(np.prod(dims))
    if kind in NUMERIC:
        return name, _read_numeric(run, dims, count)
    if kind == CHAR:
        return name, run.text().rstrip("\0") if count else ""
    if kind == CELL:
        return name, [_read_nested(run) for _ in range(count)]
    if kind in (STRUCT, OBJECT):
        return name, _read_struct(run, count, is_object=kind == OBJECT)
    return name, None


def _read_nested(run: Elements) -> Any:
    kind, body = run.take()
    if kind != MATRIX:
        raise run.error(f"an element of type {kind} stands where an array must be")
    return _read_array(run.inside(body))[1]


def _read_numeric(run: Elements, dims: NDArray[Any], count: int) -> NDArray[Any]:
    """Read real values, whatever type they were packed as; first axis fastest."""
    values = run.numbers()
    if len(values) != count:
        raise run.error(f"{count} values are declared, {len(values)} are there")
    return values.astype(np.float64).reshape(dims.tolist(), order="F").squeeze()


def _read_struct(run: Elements, count: int, *, is_object: bool) -> Any:
    if is_object:
        run.text()
    length = run.numbers()
    kind, body = run.take()
    width = int(length[0]) if len(length) else 0
    if kind not in TEXT or not 0 < width <= 4096 or len(body) % width:
        raise run.error(f"names of fields take {len(body)} bytes, {width} each")
    names = [body[k : k + width].split(b"\0")[0].decode("latin-1") for k in range(0, len(body), width)]
    if count > len(run.data):
        raise run.error(f"{count} structs are declared in {len(run.data)} bytes")
    found = [{name: _read_nested(run) for name in names} for _ in range(count)]
    return found[0] if count == 1 else found
