"""Clouds of the Point Cloud Library (`.pcd`): ascii, binary and compressed by LZF."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..meshes.cloud import Cloud
from ..text import is_count, number_rows

Columns = dict[str, NDArray[Any]]
KINDS = {"F": "f", "I": "i", "U": "u"}
SIZES = {"f": (4, 8), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8)}
MOST_BYTES = 1 << 28  # of the points, unpacked
NO_VALUES = ("x", "y", "z", "normal_x", "normal_y", "normal_z", "curvature", "rgb", "rgba", "_")


def knows(data: bytes) -> bool:
    return re.match(rb"(\s*#[^\n]*\n)*\s*(VERSION\s+\.?0?\.?[4-9]|FIELDS\s+\w)", data[:2000]) is not None


def read_cloud(path: Path, data: bytes) -> Cloud:
    """Decode the points of a PCD file with their values. Raises InputError where its head and its data do not
    fit.
    """
    head = re.search(rb"^DATA[ \t]+(ascii|binary|binary_compressed)[ \t]*\r?\n", data[:100_000], re.MULTILINE)
    if head is None:
        raise InputError(f"{path}: PCD header has no line 'DATA ascii', 'binary' or 'binary_compressed'")
    lines = data[: head.start()].decode("ascii", errors="replace").splitlines()
    words = {parts[0]: parts[1:] for line in lines if (parts := line.split())}
    kind = _read_kind(path, words)
    count = "".join(words.get("POINTS", []) or ["0"])
    if not is_count(count) or int(count) * kind.itemsize > MOST_BYTES:
        raise InputError(f"{path}: POINTS {count[:20]}: must be a count, of at most {MOST_BYTES} bytes")
    n, body = int(count), data[head.end() :]
    columns = READERS[head[1]](path, kind, n, body, len(lines) + 2)
    for axis in "xyz":
        if axis not in columns:
            raise InputError(f"{path}: has no field '{axis}'; there are {', '.join(columns)}")
    numbers = {name: np.asarray(one, dtype=np.float64) for name, one in columns.items()}
    xyz = np.column_stack([numbers[axis] for axis in "xyz"])
    values = {name: one for name, one in numbers.items() if name not in NO_VALUES and name[0] != "_"}
    return Cloud.stated(xyz, values, "\n".join(lines))


def _read_kind(path: Path, words: dict[str, list[str]]) -> np.dtype[Any]:
    """Return what a point is made of."""
    names = words.get("FIELDS", [])
    sizes, kinds = words.get("SIZE", []), words.get("TYPE", [])
    counts = words.get("COUNT", ["1"] * len(names))
    if not names or not len(names) == len(sizes) == len(kinds) == len(counts):
        raise InputError(f"{path}: FIELDS, SIZE, TYPE and COUNT of the PCD header do not name equally many")
    parts: list[tuple[str, str, tuple[int, ...]]] = []
    for k, (name, size, kind, count) in enumerate(zip(names, sizes, kinds, counts, strict=True)):
        letter = KINDS.get(kind, "")
        fits = is_count(size) and int(size) in SIZES.get(letter, ()) and is_count(count)
        if not fits or not 0 < int(count) < 1000 or name in [part[0] for part in parts]:
            stated = f"SIZE {size}, TYPE {kind}, COUNT {count}"
            raise InputError(f"{path}: field '{name}' cannot have {stated}, or comes twice")
        parts.append((f"_{k}" if name == "_" else name, f"<{letter}{size}", (int(count),)))
    return np.dtype(parts)


def _ascii_columns(path: Path, kind: np.dtype[Any], n: int, body: bytes, first: int) -> Columns:
    text = body.decode("ascii", errors="replace").splitlines()
    lines = [(k, line) for k, line in enumerate(text, first) if line.strip()]
    if len(lines) != n:
        raise InputError(f"{path}: declares {n} points and holds {len(lines)}: truncated or damaged")
    width = sum(int(np.prod(kind[name].shape)) for name in kind.names or ())
    rows = number_rows([line for _, line in lines], width, path, [k for k, _ in lines], "point")
    found, at = Columns(), 0
    for name in kind.names or ():
        k = int(np.prod(kind[name].shape))
        found[name] = rows[:, at] if k == 1 else rows[:, at : at + k]
        at += k
    return found


def _binary_columns(path: Path, kind: np.dtype[Any], n: int, body: bytes, first: int) -> Columns:
    _check_size(path, len(body), n * kind.itemsize)
    points = np.frombuffer(body, kind, n)
    return {name: _flat(points[name]) for name in kind.names or ()}


def _packed_columns(path: Path, kind: np.dtype[Any], n: int, body: bytes, first: int) -> Columns:
    """Return the fields of points packed by LZF, which stand one field behind another."""
    packed, size = (int(word) for word in np.frombuffer(body[:8].ljust(8, b"\0"), "<u4"))
    _check_size(path, size, n * kind.itemsize)
    _check_size(path, len(body) - 8, packed)
    try:
        data = unpack_lzf(body[8 : 8 + packed], size)
    except (IndexError, ValueError):
        raise InputError(f"{path}: its points do not unpack to {size} bytes; the file is damaged") from None
    found, at = Columns(), 0
    for name in kind.names or ():
        width = int(np.prod(kind[name].shape))
        found[name] = _flat(np.frombuffer(data, kind[name].base, n * width, at).reshape(n, width))
        at += n * kind[name].itemsize
    return found


def _check_size(path: Path, found: int, wanted: int) -> None:
    if found != wanted:
        raise InputError(f"{path}: declares {wanted} bytes of points and holds {found}: truncated or damaged")


def _flat(values: NDArray[Any]) -> NDArray[Any]:
    return values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values


def unpack_lzf(packed: bytes, size: int) -> bytes:
    """Return data packed by LZF. Raises IndexError or ValueError where they are not `size` bytes."""
    out = bytearray()
    at = 0
    while at < len(packed):
        control = packed[at]
        at += 1
        if control < 32:  # so many bytes, and one more, as they are
            out += packed[at : at + control + 1]
            at += control + 1
        else:  # bytes that were there before
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            start = len(out) - ((control & 31) << 8) - packed[at] - 1
            at += 1
            if start < 0:
                raise ValueError("refers to what is before the beginning")
            for k in range(start, start + length + 2):
                out.append(out[k])
        if len(out) > size:
            raise ValueError("is longer than declared")
    if len(out) != size:
        raise ValueError("is shorter than declared")
    return bytes(out)


READERS = {b"ascii": _ascii_columns, b"binary": _binary_columns, b"binary_compressed": _packed_columns}
