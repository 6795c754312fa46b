"""NRRD volumes, also Slicer's segmentations (.seg.nrrd), as they are read."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import InputError
from ..text import flat_numbers, is_count
from .layout import Layout
from .voxels import Image, along_axes, beside, beside_path, check_affine, count, inflate, shaped, size_of

TYPES = {
    **dict.fromkeys(("signed char", "int8", "int8_t"), "i1"),
    **dict.fromkeys(("uchar", "unsigned char", "uint8", "uint8_t"), "u1"),
    **dict.fromkeys(("short", "short int", "signed short", "int16", "int16_t"), "i2"),
    **dict.fromkeys(("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"), "u2"),
    **dict.fromkeys(("int", "signed int", "int32", "int32_t"), "i4"),
    **dict.fromkeys(("uint", "unsigned int", "uint32", "uint32_t"), "u4"),
    **dict.fromkeys(("longlong", "long long", "int64", "int64_t"), "i8"),
    **dict.fromkeys(("ulonglong", "unsigned long long", "uint64", "uint64_t"), "u8"),
    "float": "f4",
    "double": "f8",
}
SPACES = {
    "left-posterior-superior": (1, 1),
    "lps": (1, 1),
    "right-anterior-superior": (-1, -1),
    "ras": (-1, -1),
    "left-anterior-superior": (1, -1),
    "las": (1, -1),
}
UNITS = {"mm": 1.0, "millimeter": 1.0, "millimetre": 1.0, "um": 0.001, "µm": 0.001, "cm": 10.0, "m": 1000.0}
UNITS[""] = 1.0  # an empty unit says nothing, like a missing line
SAME_SIZE = 0.01  # share of a voxel's size: numbers in headers are rounded
LONGEST_SKIP = 1 << 20  # bytes before packed data: room for the header of another format
VECTOR = r"\(([^)]*)\)|\bnone\b"


def knows(data: bytes) -> bool:
    return data[:4] == b"NRRD"


def read_nrrd(path: Path, data: bytes, frame: str | None = None) -> Image:
    """Read the volume, one layer or several; `frame` is that of its axes where only their spacings are said.

    Raises InputError naming the header's line that cannot be used.
    """
    header, notes, end, sizes = _read_header(path, data)
    file = header.get("data file") or header.get("datafile")
    affine, space, listed = _read_place(path, header, len(sizes), frame)
    values = _read_values(path, header, beside(path, file) if file else data[end:], sizes)
    if listed is not None:  # the axes are reversed, since the first one runs fastest in the file
        values = np.moveaxis(values, 3 - listed, -1)
    return Image(values, affine, space, notes)


def layout(path: Path, data: bytes) -> Layout | None:
    """Return where the voxels of a grey image lie, by the first bytes of its file; None where it takes the
    whole file to tell. Raises InputError as `read_nrrd`.
    """
    header, _, end, sizes = _read_header(path, data)
    if "space directions" not in header and "spacings" in header:
        raise InputError(
            f"{path}: it has spacings and no space directions, so it does not say how its axes lie in the "
            "body: orient it first, as in 3D Slicer"
        )
    affine, space, listed = _read_place(path, header, len(sizes), None)
    kind, encoding = TYPES.get(header.get("type", "").lower()), header.get("encoding", "").lower()
    skips = [header.get(key, "0") for key in ("line skip", "lineskip", "byte skip", "byteskip")]
    plain = kind is not None and listed is None and encoding in ("raw", "gzip", "gz")
    if not plain or any(skip != "0" for skip in skips):
        return None
    file = header.get("data file") or header.get("datafile")
    where = beside_path(path, file) if file else path
    dtype = (">" if header.get("endian", "little") == "big" else "<") + str(kind)
    begin = 0 if file else end
    offset, begin = (begin, 0) if encoding == "raw" else (0, begin)
    return Layout(where, offset, dtype, tuple(sizes), affine, space, begin)


def _read_header(path: Path, data: bytes) -> tuple[dict[str, str], dict[str, str], int, list[int]]:
    """Return the fields of the header, its notes, the byte behind it, and the sizes of the axes."""
    end = re.search(rb"\r?\n\r?\n", data[:1_000_000])
    head = data[: end.start()] if end else data[:1_000_000]
    lines = [
        line
        for line in head.decode("utf-8", errors="replace").splitlines()[1:]
        if line and not line.startswith("#")
    ]
    notes = dict(line.split(":=", 1) for line in lines if ":=" in line)
    header = {
        key.strip().lower(): value.strip()
        for key, _, value in (line.partition(":") for line in lines if ":=" not in line)
    }
    file = header.get("data file") or header.get("datafile")
    if end is None and file is None:
        raise InputError(f"{path}: NRRD header does not end in a blank line; the file is truncated")
    sizes = [int(word) if is_count(word) else -1 for word in header.get("sizes", "").split()]
    if len(sizes) not in (3, 4) or header.get("dimension") != str(len(sizes)):
        raise InputError(
            f"{path}: NRRD has dimension {header.get('dimension')} and sizes {header.get('sizes')}: must "
            "be 3, or 4 with an axis of layers"
        )
    return header, notes, end.end() if end else 0, sizes


def _read_place(
    path: Path, header: Mapping[str, str], axes: int, frame: str | None
) -> tuple[Array, str, int | None]:
    """Read the matrix from an index to mm in LPS, the frame, and which axis is that of the layers.

    A file that names no space stays in its own, which is unknown.
    """
    if "space directions" not in header and "spacings" in header:
        return _place_by_spacings(path, header, axes, frame)
    vectors = [match[1] for match in re.finditer(VECTOR, header.get("space directions", ""))]
    if len(vectors) != axes or sum(vector is not None for vector in vectors) != 3:
        raise InputError(
            f"{path}: NRRD 'space directions' must hold three vectors, and 'none' for an axis of layers"
        )
    affine = np.eye(4)
    for k, vector in enumerate(v for v in vectors if v is not None):
        affine[:3, k] = flat_numbers(vector.replace(",", " "), 3, f"{path}: space directions")
    origin = re.match(VECTOR, header.get("space origin", "(0,0,0)"))
    if origin is None or origin[1] is None:
        raise InputError(f"{path}: NRRD 'space origin' must be a vector")
    affine[:3, 3] = flat_numbers(origin[1].replace(",", " "), 3, f"{path}: space origin")
    affine[:3] *= _read_units(path, header, "space units", [0, 1, 2])[:, None]
    check_affine(f"{path}: NRRD 'space directions' and 'space origin'", affine)
    _check_spacings(path, header, axes, affine)
    listed = vectors.index(None) if axes == 4 else None
    name = header.get("space", "").lower()
    if not name:
        return affine, "unknown", listed
    if name not in SPACES:
        raise InputError(f"{path}: NRRD space '{name[:40]}': must be one of {', '.join(SPACES)}")
    return np.diag([*SPACES[name], 1.0, 1.0]) @ affine, "LPS", listed


def _place_by_spacings(
    path: Path, header: Mapping[str, str], axes: int, frame: str | None
) -> tuple[Array, str, int | None]:
    """Return the same as `_read_place` for a file that states sizes of voxels alone; an axis of layers has
    none (nan).
    """
    for key in ("space", "space origin", "axis mins", "axismins"):
        if header.get(key):
            raise InputError(
                f"{path}: NRRD has '{key}' beside 'spacings': write 'space directions' and 'space origin'"
            )
    sizes = flat_numbers(header["spacings"], axes, f"{path}: spacings")
    spatial = np.flatnonzero(np.isfinite(sizes)).tolist()
    if len(spatial) != 3 or not (sizes[spatial] > 0.0).all():
        raise InputError(
            f"{path}: NRRD spacings {header['spacings'][:60]}: must be three above 0, and nan for an axis of "
            "layers"
        )
    spacing = sizes[spatial] * _read_units(path, header, "units", spatial)
    listed = ({*range(axes)} - {*spatial}).pop() if axes == 4 else None
    return *along_axes(str(path), "it has spacings and no space directions", spacing, frame), listed


def _check_spacings(path: Path, header: Mapping[str, str], axes: int, affine: Array) -> None:
    """Raise InputError where a file states sizes of voxels too, and others than its directions have."""
    if "spacings" not in header:
        return
    stated = flat_numbers(header["spacings"], axes, f"{path}: spacings")
    stated = stated[np.isfinite(stated)]
    sizes = np.linalg.norm(affine[:3, :3], axis=0)
    if len(stated) == 3 and not np.allclose(stated, sizes, rtol=SAME_SIZE):
        raise InputError(
            f"{path}: NRRD 'spacings: {header['spacings'][:40]}' and the lengths of 'space directions', "
            f"{sizes.round(4).tolist()}, contradict: leave the one that is right"
        )


def _read_units(path: Path, header: Mapping[str, str], key: str, axes: list[int]) -> Array:
    """Read the factors to mm along three axes, by a line of units. Raises InputError for units that are not
    known.
    """
    stated = header.get(key, '"" ' * (max(axes) + 1))
    words = [quoted or bare for quoted, bare in re.findall(r'"([^"]*)"|([^\s"]+)', stated)]
    others = [word for k, word in enumerate(words) if k not in axes]
    # units of the layers, such as ms, are of no length; behind the units of space none may stand
    if (
        len(words) <= max(axes)
        or (key == "space units" and any(others))
        or not {words[k] for k in axes} <= UNITS.keys()
    ):
        raise InputError(
            f"{path}: NRRD {key} {stated[:60]}: must be three of {', '.join(filter(None, UNITS))}, "
            "each in quotes"
        )
    return np.array([UNITS[words[k]] for k in axes])


def _read_values(path: Path, header: Mapping[str, str], body: bytes, sizes: list[int]) -> NDArray[Any]:
    kind = TYPES.get(header.get("type", "").lower())
    if kind is None:
        raise InputError(
            f"{path}: NRRD type '{header.get('type', '')[:40]}' must be one of {', '.join(sorted(TYPES))}"
        )
    n = count(path, sizes)
    encoding = header.get("encoding", "").lower()
    dtype = np.dtype((">" if header.get("endian", "little") == "big" else "<") + kind)
    lines, skipped = _read_skip(path, header, "line skip"), _read_skip(path, header, "byte skip")
    body = body.split(b"\n", lines)[-1] if body.count(b"\n") >= lines else b""
    if skipped < 0:  # -1 means that the data are the last bytes of the file
        if encoding != "raw":
            raise InputError(f"{path}: NRRD 'byte skip: -1' must go with raw encoding, not {encoding[:20]}")
        skipped = max(len(body) - n * dtype.itemsize, 0)
    if encoding in ("gzip", "gz"):
        body = bytes(inflate(path, body, min(skipped, LONGEST_SKIP) + size_of(path, sizes, dtype.str)))
    body = body[skipped:]
    if encoding in ("ascii", "txt", "text"):
        numbers = flat_numbers(body.decode("ascii", errors="replace"), n, f"{path}: data")
        return numbers.reshape(sizes[::-1])
    if encoding not in ("gzip", "gz", "raw"):
        raise InputError(f"{path}: NRRD encoding '{encoding[:20]}': must be raw, gzip or ascii")
    return shaped(path, body, dtype.str, sizes)


def _read_skip(path: Path, header: Mapping[str, str], key: str) -> int:
    """Read how many lines or bytes stand before the data, under either spelling of the key; -1 bytes: all but
    the data.
    """
    words = [header[name] for name in (key, key.replace(" ", "")) if name in header]
    if not all(is_count(word) or (word == "-1" and key == "byte skip") for word in words):
        raise InputError(f"{path}: NRRD '{key}: {words[0][:20]}' must be a whole number from 0")
    if len(set(words)) > 1:
        raise InputError(f"{path}: NRRD has '{key}' twice, {' and '.join(words)}")
    return int(words[0]) if words else 0
