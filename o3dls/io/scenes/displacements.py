"""Fields of displacements on grids: as ITK's composite in HDF5 (`.h5`), and as a NRRD of vectors.

All of it is in LPS and mm. A transform of ITK leads from the grid that is resampled onto to the image that is
resampled; Slicer, reading one, turns it around.
"""

from __future__ import annotations

import gzip
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Array
from ...errors import InputError
from ..atomic import write_file
from ..meshes.surface_file import NOTICE

NEEDS = "is written with h5py: pip install 'o3dls[itk]'; or name a .tfm, whose field is a NRRD beside it"
KIND = "{}_double_3_3"
Field = tuple[
    NDArray[np.float32], Array
]  # displacements (nx, ny, nz, 3), and the affine (4, 4) of their nodes


def check_itk(path: Path) -> None:
    """Raise InputError where `.h5` cannot be written, before any work."""
    if path.suffix.lower() == ".h5":
        try:
            import h5py  # noqa: F401
        except ImportError as error:
            raise InputError(f"{path}: {NEEDS}") from error


def write_composite(path: Path, parts: Sequence[Array | Field]) -> None:
    """Write transforms as one of ITK, `.h5`: matrices (4, 4) and fields, of which the last acts first."""
    check_itk(path)
    import h5py

    groups: list[tuple[str, Array | None, Any]] = [(KIND.format("CompositeTransform"), None, None)]
    groups += [_affine_group(part) if isinstance(part, np.ndarray) else _field_group(*part) for part in parts]
    content = io.BytesIO()
    with h5py.File(content, "w", track_order=False) as file:
        for name, text in {
            "ITKVersion": "5.4.0",
            "HDFVersion": "1.12.2",
            "OSName": "",
            "OSVersion": "",
        }.items():
            file.create_dataset(name, data=[text or NOTICE], dtype=h5py.string_dtype("ascii"))
        whole = file.create_group("TransformGroup")
        for k, (kind, fixed, parameters) in enumerate(groups):
            group = whole.create_group(str(k))
            group.create_dataset("TransformType", data=[kind], dtype=h5py.string_dtype("ascii"))
            if fixed is not None:
                group.create_dataset("TransformFixedParameters", data=fixed)
                packed = {"compression": "gzip", "shuffle": True} if parameters.size > 1000 else {}
                group.create_dataset("TransformParameters", data=parameters, **packed)
    write_file(path, content.getvalue())


def _affine_group(matrix: Array) -> tuple[str, Array, Array]:
    parameters = np.r_[matrix[:3, :3].ravel(), matrix[:3, 3]]
    return KIND.format("AffineTransform"), np.zeros(3), parameters


def _field_group(values: NDArray[np.float32], affine: Array) -> tuple[str, Array, NDArray[np.float32]]:
    """Return the size, origin, spacing and direction of a grid, and its vectors, first axis fastest."""
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    direction = affine[:3, :3] / spacing
    fixed = np.r_[values.shape[:3], affine[:3, 3], spacing, direction.ravel()].astype(np.float64)
    return KIND.format("DisplacementFieldTransform"), fixed, values.transpose(2, 1, 0, 3).ravel()


def write_vectors(path: Path, values: NDArray[np.float32], affine: Array) -> None:
    """Write displacements (nx, ny, nz, 3) as a NRRD of vectors, a grid transform of Slicer's."""
    axes = " ".join(f"({','.join(map(repr, axis))})" for axis in affine[:3, :3].T.tolist())
    lines = [
        "NRRD0004",
        f"# {NOTICE}",
        "type: float",
        "dimension: 4",
        "space: left-posterior-superior",
        f"sizes: 3 {' '.join(map(str, values.shape[:3]))}",
        f"space directions: none {axes}",
        "kinds: vector domain domain domain",
        "endian: little",
        "encoding: gzip",
        f"space origin: ({','.join(map(repr, affine[:3, 3].tolist()))})",
    ]
    data = np.ascontiguousarray(values.transpose(2, 1, 0, 3), dtype="<f4").tobytes()
    write_file(path, ("\n".join(lines) + "\n\n").encode() + gzip.compress(data, 4, mtime=0))
