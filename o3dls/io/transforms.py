"""Poses from and to files: 4x4 text, and ITK's transforms as Slicer and ANTs write them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.similarity import TURN
from .atomic import write_file
from .itk_transforms import HEAD, LARGEST, read_itk_mat, read_itk_text
from .matlab.mat4 import first_name, is_itk
from .meshes.surface_file import NOTICE
from .text import decode, number_rows, read_bytes


def turned(matrix: Array) -> Array:
    """Return a transform of LPS coordinates as one of RAS coordinates, and the other way round."""
    return TURN @ matrix @ TURN


def write_transform(path: str | Path, T_map_prior: Array, space: str) -> None:
    """Write a pose: `.txt` holds T_map_prior as 4x4 rows, `.tfm` is ITK's, in LPS and from map to prior as
    ITK resamples.

    Slicer turns a .tfm around on reading, so that there it moves the prior onto the map. Raises InputError
    for other suffixes, and for .tfm where the frame is not known.
    """
    path = Path(path)
    if path.suffix.lower() == ".txt":
        text = f"# T_map_prior, mm, SPACE={space}, {NOTICE}\n" + "".join(
            " ".join(map(repr, row)) + "\n" for row in T_map_prior.tolist()
        )
    elif path.suffix.lower() == ".tfm":
        text = _itk_text(path, T_map_prior, space)
    else:
        raise InputError(f"{path}: transforms are written as .txt (4x4) or .tfm (ITK, Slicer)")
    write_file(path, text)


def _itk_text(path: Path, T_map_prior: Array, space: str) -> str:
    if space not in ("LPS", "RAS") or T_map_prior.shape != (4, 4):
        raise InputError(
            f"{path}: ITK transforms are in LPS and 3D; the frame here is '{space}': must be LPS or RAS"
        )
    inverse = np.linalg.inv(T_map_prior if space == "LPS" else turned(T_map_prior))
    numbers = " ".join(map(repr, [*inverse[:3, :3].ravel().tolist(), *inverse[:3, 3].tolist()]))
    return (
        f"{HEAD}\n#Transform 0\nTransform: AffineTransform_double_3_3\nParameters: "
        f"{numbers}\nFixedParameters: 0 0 0\n"
    )


def is_transform(path: str | Path) -> bool:
    """Return whether a file is a pose by its suffix `.tfm` or `.txt`, or a MATLAB 4 file with a transform of
    ITK.

    Raises InputError where it cannot be read at all.
    """
    name = first_name(read_bytes(path))
    return Path(path).suffix.lower() in (".tfm", ".txt") or (name is not None and is_itk(name))


def read_transform(path: str | Path) -> tuple[Array, str]:
    """Read T_map_prior (4, 4) and its frame (`unknown` for plain text that does not state it); ITK's linear
    transforms, by their content, are in LPS and from map to prior. Raises InputError.
    """
    path = Path(path)
    data = read_bytes(path)
    if first_name(data):
        return _invert_transform(path, read_itk_mat(path, data)), "LPS"
    text = decode(data, path)
    if text.startswith(HEAD):
        return _invert_transform(path, read_itk_text(path, text)), "LPS"
    return _read_rows(path, text)


def _invert_transform(path: Path, matrix: Array) -> Array:
    if not (np.abs(matrix) < LARGEST).all() or abs(np.linalg.det(matrix[:3, :3])) < 1e-9:
        raise InputError(f"{path}: its transform cannot be turned around: it is singular or not finite")
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _read_rows(path: Path, text: str) -> tuple[Array, str]:
    lines = [
        (k, line.replace(",", " "))
        for k, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    if len(lines) != 4:
        raise InputError(f"{path}: has {len(lines)} rows of numbers: a 4x4 transform has four")
    matrix = number_rows([line for _, line in lines], 4, path, [k for k, _ in lines], "row")
    if not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise InputError(f"{path}: line {lines[3][0]}: the last row must be 0 0 0 1")
    _invert_transform(path, matrix)
    stated = re.search(r"SPACE=(\w+)", text)
    return matrix, stated[1] if stated else "unknown"
