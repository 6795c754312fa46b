"""Poses from and to files: 4x4 text, and ITK `.tfm` as Slicer reads it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..geometry.similarity import TURN, similarity
from .atomic import write_file
from .meshes.surface_file import NOTICE
from .text import decode, number_rows, read_bytes

LARGEST = 1e9  # mm; also keeps products finite
ITK_HEAD = "#Insight Transform File V1.0"
ITK_AFFINE = re.compile("(AffineTransform|MatrixOffsetTransformBase)_(double|float)_3_3")


def turned(matrix: Array) -> Array:
    """A transform of LPS coordinates as one of RAS coordinates, and back."""
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
        f"{ITK_HEAD}\n#Transform 0\nTransform: AffineTransform_double_3_3\nParameters: "
        f"{numbers}\nFixedParameters: 0 0 0\n"
    )


def read_transform(path: str | Path) -> tuple[Array, str]:
    """T_map_prior (4, 4) and its frame (`unknown` for plain text that does not state it). Raises
    InputError.
    """
    path = Path(path)
    text = decode(read_bytes(path), path)
    return (_read_itk(path, text), "LPS") if text.startswith(ITK_HEAD) else _read_rows(path, text)


def _read_itk(path: Path, text: str) -> Array:
    kinds = re.findall(r"^Transform:[ \t]*(.*?)[ \t]*$", text.replace("\r", ""), re.MULTILINE)
    parts = {
        key: re.search(rf"^{key}:(.*)$", text, re.MULTILINE) for key in ("Parameters", "FixedParameters")
    }
    readable = len(kinds) == 1 and ITK_AFFINE.fullmatch(kinds[0])
    if not readable or parts["Parameters"] is None or parts["FixedParameters"] is None:
        raise InputError(
            f"{path}: holds {', '.join(kinds) or 'no transform'}: must hold one AffineTransform in 3D with "
            "Parameters and FixedParameters"
        )
    values = number_rows([parts["Parameters"][1]], 12, path, [0], "Parameters")[0]
    centre = number_rows([parts["FixedParameters"][1]], 3, path, [0], "FixedParameters")[0]
    linear = values[:9].reshape(3, 3)
    if not (np.abs([*values, *centre]) < LARGEST).all():
        raise InputError(f"{path}: its parameters must be finite and below {LARGEST:g}")
    return _inverse(path, similarity(linear, values[9:] + centre - linear @ centre))


def _inverse(path: Path, matrix: Array) -> Array:
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
    _inverse(path, matrix)
    stated = re.search(r"SPACE=(\w+)", text)
    return matrix, stated[1] if stated else "unknown"
