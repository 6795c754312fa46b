"""NIfTI-1 and NIfTI-2 volumes, in one file or as a pair .hdr and .img; RAS by definition, brought to LPS.

nibabel reads the header. The voxels are read here, since it takes the memory that a damaged header claims.
"""

from __future__ import annotations

import re
import zlib
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ...arrays import Array
from ...errors import Doubt, InputError, choices
from ...geometry.similarity import TURN
from .layout import Layout
from .voxels import Image, along_axes, beside, check_affine, inflate, packed, shaped, size_of

# class of the header by its size, where its magic word stands, and what that is in one file and in a pair
HEADERS = {
    348: ("Nifti1Header", 344, b"n+1\0", b"ni1\0"),
    540: ("Nifti2Header", 4, b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n"),
}
LONGEST_HEADER = 1_000_000  # bytes, with its extensions
SAME_SIZE = 0.01  # share of a voxel's size: numbers in headers are rounded
ORDERS: tuple[Literal["little", "big"], ...] = ("little", "big")
UNITS = {1: ("m", 1000.0), 3: ("um", 0.001)}  # any other code means mm
SAY_FORM = "look which is right, and say --form sform or --form qform, or write it into both"


def knows(data: bytes) -> bool:
    start = _unpack_start(data)
    return _header_kind(start) is not None or _is_analyze(start)


def _unpack_start(data: bytes) -> bytes:
    """Return as many bytes of the file, unpacked, as the longest header has."""
    if not packed(data):
        return data[: max(HEADERS)]
    try:
        return zlib.decompressobj(wbits=31).decompress(data[:20_000], max(HEADERS))
    except zlib.error:
        return b""


def _header_kind(start: bytes) -> tuple[int, bool] | None:
    """Return the size of the header, and whether the voxels are in the same file; None for other files."""
    for size, (_, at, single, pair) in HEADERS.items():
        if start[at : at + len(single)] in (single, pair) and len(start) >= size:
            return size, start[at : at + len(single)] == single
    return None


def _is_analyze(start: bytes) -> bool:
    """Return whether a file is a header of Analyze 7.5, which has the size of NIfTI's and no magic word."""
    return (
        len(start) == 348 and not any(start[344:]) and 348 in (int.from_bytes(start[:4], o) for o in ORDERS)
    )


@np.errstate(over="ignore", invalid="ignore")  # numbers that overflow are refused where they are checked
def read_nifti(path: Path, data: bytes, frame: str | None = None, form: str | None = None) -> Image:
    """Read the volume, 3D or with layers (phases in time); `frame` is that of its axes where no form says it,
    `form` the one that is right where two contradict.
    """
    header, single = _read_start(path, data)
    sizes, dtype, offset, scaling = _describe_voxels(path, header)
    _check_offset(path, offset, header, single=single)
    most = offset + size_of(path, sizes, dtype.str)
    body = _unpack_file(path, data, most) if single else _read_pair(path, data, most)
    values = shaped(path, memoryview(body)[offset:], dtype.str, sizes)  # which copies nothing
    if scaling is not None and scaling != (1.0, 0.0):
        values = values * scaling[0] + scaling[1]
    values = np.moveaxis(values, 0, -1) if values.ndim == 4 else values
    return Image(values, *place(header, str(path), frame, form), stated_units(header))


def _read_start(path: Path, data: bytes) -> tuple[Any, bool]:
    """Return the header at the start of a file, and whether the voxels follow in the same one."""
    start = _unpack_start(data)
    kind = _header_kind(start)
    if kind is None:
        raise InputError(f"{path}: is Analyze 7.5, which does not say left from right: save it as NIfTI")
    size, single = kind
    return _read_header(path, start[:size]), single


def _check_offset(path: Path, offset: int, header: Any, *, single: bool) -> None:
    size = int(header["sizeof_hdr"]) if single else 0  # which was compared with what was read
    if offset < size:
        raise InputError(f"{path}: has its voxels at byte {offset}, within the header of {size} bytes")


@np.errstate(over="ignore", invalid="ignore")
def layout(path: Path, data: bytes) -> Layout:
    """Return where the voxels of a grey image lie, by the first bytes of its file. Raises InputError as
    `read_nifti`, and where neither form says how it lies.
    """
    header, single = _read_start(path, data)
    sizes, dtype, offset, scaling = _describe_voxels(path, header)
    _check_offset(path, offset, header, single=single)
    if not (int(header["sform_code"]) > 0 or int(header["qform_code"]) > 0):
        raise InputError(
            f"{path}: its header has neither qform nor sform, so it does not say how its axes lie in the "
            "body: orient it first, as in 3D Slicer"
        )
    affine, _ = place(header, str(path), None, advice="look which is right, and write it into both")
    file = path if single else path.parent / _image_name(path)
    return Layout(file, offset, dtype.str, tuple(sizes), affine, "LPS", 0, scaling or (1.0, 0.0))


def _units(header: Any) -> tuple[str, float]:
    """Return the units of a header, and their factor to mm."""
    return UNITS.get(int(header["xyzt_units"]) & 7, ("mm", 1.0))


def stated_units(header: Any) -> dict[str, str]:
    """Return the note of an image by whose units of lengths it was brought to mm."""
    return {"units": _units(header)[0]}


def _unpack_file(path: Path, body: bytes, most: int) -> bytes | bytearray:
    return inflate(path, body, most) if packed(body) else body


def _read_pair(path: Path, header: bytes, most: int) -> bytes | bytearray:
    """Read the file of a pair that holds the voxels, unpacked; the header's own checksum must hold too."""
    _unpack_file(path, header, LONGEST_HEADER)
    name = _image_name(path)
    body = beside(path, name)
    # an .img has no magic word: damaged gzip data must not pass for voxels
    return inflate(path, body, most) if name.endswith(".gz") else _unpack_file(path, body, most)


def _image_name(path: Path) -> str:
    """Return the file of a pair that holds the voxels."""
    stem = re.sub(r"\.hdr(\.gz)?$", "", path.name, flags=re.IGNORECASE)
    names = [stem + ".img", stem + ".img.gz", stem + ".IMG"]
    return next((name for name in names if (path.parent / name).is_file()), names[0])


def _read_header(path: Path, block: bytes) -> Any:
    """Return nibabel's header of the bytes as they are: what its own checks would repair is refused below."""
    import nibabel

    order = next((o for o in ORDERS if int.from_bytes(block[:4], o) == len(block)), None)
    if order is None:
        raise InputError(
            f"{path}: its header says {block[:4]!r} for its own size of {len(block)} bytes: is damaged"
        )
    return getattr(nibabel, HEADERS[len(block)][0])(block, endianness=order, check=False)


def _describe_voxels(
    path: Path, header: Any
) -> tuple[list[int], np.dtype[Any], int, tuple[float, float] | None]:
    """Return sizes of the axes, four where there are layers; type and first byte of the voxels; slope and
    intercept, or None.
    """
    from nibabel.spatialimages import HeaderDataError

    try:
        shape, dtype = header.get_data_shape(), header.get_data_dtype()
        offset = int(header["vox_offset"])
        slope, intercept = header.get_slope_inter()
    except (HeaderDataError, ArithmeticError, KeyError, ValueError) as error:
        raise InputError(f"{path}: its header is damaged: {error}") from None
    sizes = [*map(int, shape[:3]), *(int(n) for n in shape[3:] if n != 1)]
    if len(shape) < 3 or len(sizes) > 4:
        raise InputError(f"{path}: has axes of {sizes}: must be one volume in 3D, or several along one axis")
    if dtype.kind not in "iuf" or offset > LONGEST_HEADER:
        raise InputError(f"{path}: has voxels of {dtype} at byte {offset}: must be whole or real numbers")
    return sizes, dtype, offset, None if slope is None else (slope, intercept)


@np.errstate(over="ignore", invalid="ignore")
def place(
    header: Any, where: str, frame: str | None, form: str | None = None, *, advice: str = SAY_FORM
) -> tuple[Array, str]:
    """Return the matrix from an index to mm, and the frame, by a header of nibabel: its sform if there is
    one, else its qform; the one that is said, where there are both.

    Without either, the axes run along those of `frame`. Raises InputError where that is not said, and where
    the header contradicts itself.
    """
    factor = _units(header)[1]
    pixdim = np.asarray(header["pixdim"], dtype=np.float64)
    forms = {}
    if int(header["sform_code"]) > 0 and form != "qform":
        forms["sform"] = np.asarray(header.get_sform(), dtype=np.float64)
        _check_voxel_sizes(where, forms["sform"], pixdim[1:4])
    if int(header["qform_code"]) > 0 and form != "sform":
        forms["qform"] = _read_qform(header, where)
    if form is not None and form not in forms:
        raise InputError(f"{where}: its header has no {form}: omit --form")
    if not forms:
        return along_axes(
            where, "its header has neither qform nor sform", np.abs(pixdim[1:4]) * factor, frame
        )
    if len(forms) == 2:
        _check_same_place(where, header, forms["sform"], forms["qform"], factor, advice)
    affine = next(iter(forms.values()))
    return check_affine(where, TURN @ np.diag([factor, factor, factor, 1.0]) @ affine), "LPS"


def _check_same_place(
    where: str, header: Any, sform: Array, qform: Array, factor: float, advice: str
) -> None:
    """Raise InputError with advice where the two forms of a header put a corner of the volume more than a
    voxel apart: programs differ in which of them they follow.
    """
    ends = [(0, max(int(n) - 1, 0)) for n in header.get_data_shape()[:3]]
    corners = np.array([[*corner, 1] for corner in product(*ends)], dtype=np.float64)
    apart = float(np.linalg.norm(corners @ (sform - qform).T, axis=1).max())
    if not apart <= np.linalg.norm(sform[:3, :3], axis=0).max():
        mirrored = np.linalg.det(sform[:3, :3]) * np.linalg.det(qform[:3, :3]) < 0.0
        raise Doubt(
            f"{where}: its sform and its qform put the volume up to {apart * factor:.3g} mm apart"
            f"{', one the mirror image of the other' if mirrored else ''}",
            f"programs differ in which they follow: {advice}",
            choices("form", ("sform", "qform"), "the {} is right"),
        )


def _read_qform(header: Any, where: str) -> Array:
    from nibabel.spatialimages import HeaderDataError

    header = header.copy()
    header["pixdim"][0] = -1.0 if header["pixdim"][0] < 0 else 1.0  # 0 is taken for 1, as the standard says
    try:
        return np.asarray(header.get_qform(), dtype=np.float64)
    except (HeaderDataError, ValueError) as error:
        raise InputError(f"{where}: its qform is not a rotation: {error}") from None


def _check_voxel_sizes(where: str, affine: Array, pixdim: Array) -> None:
    """Refuse a sform whose voxels have other sizes than the header's pixdim (3,): one of them is wrong, or
    the sform leads to another body, as to a standard brain.
    """
    sizes = np.linalg.norm(affine[:3, :3], axis=0)
    said = np.abs(pixdim)
    stated = np.isfinite(said) & (said > 0.0)
    if (np.abs(sizes - said)[stated] > SAME_SIZE * said[stated]).any():
        ours, theirs = (" x ".join(f"{size:.4g}" for size in three) for three in (sizes, said))
        raise InputError(
            f"{where}: its sform has voxels of {ours}, its pixdim of {theirs}: make them agree, with the "
            "sizes that the scanner had"
        )
