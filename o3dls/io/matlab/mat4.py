"""MATLAB version 4 files: named matrices and no structs, as ITK and ANTs write their affine transforms."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...errors import InputError

LONGEST = 256  # bytes of a variable's name


def first_name(data: bytes) -> str | None:
    """Return the name of the first variable; None where the bytes begin no MATLAB 4 file."""
    for order, machine in (("<", 0), (">", 1)):
        if len(data) < 20:
            return None
        kind, rows, columns, imaginary, length = np.frombuffer(data, f"{order}i4", 5).tolist()
        name = data[20 : 20 + length] if 2 <= length <= LONGEST else b""
        plain = kind // 100 == 10 * machine and kind // 10 % 10 <= 5 and kind % 10 <= 2
        if plain and min(rows, columns) >= 0 and imaginary in (0, 1) and name[-1:] == b"\0":
            word = name[:-1].decode("latin-1")
            return word if word.isascii() and word.isidentifier() else None
    return None


def is_itk(name: str) -> bool:
    """Return whether a variable's name is that of a transform of ITK."""
    return re.fullmatch(r"\w+_(double|float)_\d_\d", name) is not None


def read_mat4(path: Path, data: bytes) -> list[tuple[str, Array]]:
    """Read names and real numbers (n,) of all variables, in order; at least one. Raises InputError."""
    from scipy.io import loadmat, whosmat

    # scipy reads as version 5 what is none of 4, and crashes on damaged ones
    if first_name(data) is None:
        raise InputError(f"{path}: is not a MATLAB 4 file")
    try:
        names = [name for name, *_ in whosmat(io.BytesIO(data))]  # type: ignore[arg-type]  # the stubs leave files out
        found = loadmat(io.BytesIO(data))  # type: ignore[arg-type]  # the stubs leave files out
        values = [(name, np.asarray(found[name], dtype=np.float64).ravel()) for name in names]
    except Exception as error:  # a foreign parser, which raises whatever it meets
        raise InputError(
            f"{path}: is not a readable MATLAB 4 file: {error}; it is truncated or damaged"
        ) from error
    if len(set(names)) < len(names):
        raise InputError(f"{path}: a variable of {', '.join(names)} appears twice")
    return values
