"""Level sets and masks as image volumes: NRRD and NIfTI, written without a library."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import InputError
from ...geometry.similarity import TURN
from ..atomic import write_file
from ..meshes.surface_file import NOTICE

NRRD_TYPES = {"u1": "uchar", "f4": "float"}
NRRD_SPACES = {
    "LPS": "space: left-posterior-superior",
    "RAS": "space: right-anterior-superior",
    "unknown": "space dimension: 3",
}
NIFTI_TYPES = {"u1": (2, 8), "f4": (16, 32)}


def write_volume(path: str | Path, values: NDArray[Any], affine: Array, *, space: str) -> None:
    """Write values (nx, ny, nz); `affine` (4, 4) takes an index, a voxel centre, to mm in the frame
    `space`.

    Bool becomes uint8 and uint8 stays, all else becomes float32. `.nrrd` takes any frame; `.nii` and
    `.nii.gz` are RAS by definition. Raises InputError.
    """
    path = Path(path)
    data = np.asarray(values, dtype="<u1" if values.dtype in (bool, np.uint8) else "<f4")
    if data.ndim != 3:
        raise InputError(f"{path}: volumes are written in 3D; these values are {data.ndim}D")
    name = path.name.lower()
    if name.endswith(".nrrd"):
        content = _encode_nrrd(data, affine, space)
    elif name.endswith((".nii", ".nii.gz")):
        content = _encode_nifti(path, data, affine, space)
        content = gzip.compress(content, 6, mtime=0) if name.endswith(".gz") else content
    else:
        raise InputError(f"{path}: volumes are written as .nrrd, .nii or .nii.gz")
    write_file(path, content)


def _encode_nrrd(data: NDArray[Any], affine: Array, space: str) -> bytes:
    axes = " ".join(f"({','.join(map(repr, axis))})" for axis in affine[:3, :3].T.tolist())
    lines = [
        "NRRD0004",
        f"# {NOTICE}",
        f"type: {NRRD_TYPES[data.dtype.str[1:]]}",
        "dimension: 3",
        NRRD_SPACES[space],
        f"sizes: {' '.join(map(str, data.shape))}",
        f"space directions: {axes}",
        "kinds: domain domain domain",
        "endian: little",
        "encoding: gzip",
        f"space origin: ({','.join(map(repr, affine[:3, 3].tolist()))})",
    ]
    return ("\n".join(lines) + "\n\n").encode() + gzip.compress(data.tobytes(order="F"), 6, mtime=0)


def _encode_nifti(path: Path, data: NDArray[Any], affine: Array, space: str) -> bytes:
    """Encode as NIfTI-1 with an sform in scanner coordinates, which are RAS."""
    if space not in ("LPS", "RAS"):
        raise InputError(
            f"{path}: NIfTI is RAS by definition and the frame is '{space}'; state LPS or RAS, or write .nrrd"
        )
    affine = (TURN @ affine if space == "LPS" else affine)[:3]
    code, bits = NIFTI_TYPES[data.dtype.str[1:]]
    header = np.zeros(1, dtype=NIFTI)
    for name, value in {
        "sizeof_hdr": 348,
        "dim": [3, *data.shape, 1, 1, 1, 1],
        "datatype": code,
        "bitpix": bits,
        "pixdim": [1, *np.linalg.norm(affine[:, :3], axis=0), 0, 0, 0, 0],
        "vox_offset": 352,
        "scl_slope": 1,
        "xyzt_units": 2,
        "descrip": NOTICE.encode(),
        "sform_code": 1,
        "srow": affine,
        "magic": b"n+1",
    }.items():
        header[name] = value
    return header.tobytes() + b"\0" * 4 + data.tobytes(order="F")


NIFTI = np.dtype(
    [
        ("sizeof_hdr", "<i4"),
        ("unused", "S35"),
        ("dim_info", "u1"),
        ("dim", "<i2", (8,)),
        ("intent", "<f4", (3,)),
        ("intent_code", "<i2"),
        ("datatype", "<i2"),
        ("bitpix", "<i2"),
        ("slice_start", "<i2"),
        ("pixdim", "<f4", (8,)),
        ("vox_offset", "<f4"),
        ("scl_slope", "<f4"),
        ("scl_inter", "<f4"),
        ("slice_end", "<i2"),
        ("slice_code", "u1"),
        ("xyzt_units", "u1"),
        ("cal", "<f4", (2,)),
        ("slice_duration", "<f4"),
        ("toffset", "<f4"),
        ("gl", "<i4", (2,)),
        ("descrip", "S80"),
        ("aux_file", "S24"),
        ("qform_code", "<i2"),
        ("sform_code", "<i2"),
        ("quatern", "<f4", (6,)),
        ("srow", "<f4", (3, 4)),
        ("intent_name", "S16"),
        ("magic", "S4"),
    ]
)
