"""MATLAB files of versions 5 and 7.3 (which needs h5py) as nested dictionaries of arrays."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from .mat4 import first_name, is_itk
from .mat5 import Opaque, read_mat5

HDF5 = b"\x89HDF\r\n\x1a\n"
LARGEST = 1 << 30  # values in one variable; a larger count is damage


def knows(data: bytes) -> bool:
    """Return whether the bytes begin a MATLAB file; one of version 4 may also be a transform of ITK, and is
    none then.
    """
    name = first_name(data)
    return data[:10] in (b"MATLAB 5.0", b"MATLAB 7.3") or data[:8] == HDF5 or bool(name and not is_itk(name))


def load(path: Path, data: bytes) -> dict[str, Any]:
    """Return the variables by name; structs are dictionaries, cells of other things lists, MATLAB objects
    `Opaque`. Raises InputError where the file is damaged, or of version 4.
    """
    if name := first_name(data):
        raise InputError(
            f"{path}: is a MATLAB version 4 file ({name}, ...), which has no structs and so no OpenEP data "
            "set; save it with -v7"
        )
    return _load_hdf5(path, data) if HDF5 in data[:1024] else read_mat5(path, data)


def _load_hdf5(path: Path, data: bytes) -> dict[str, Any]:
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            f"{path}: is a MATLAB 7.3 file, which needs h5py: pip install 'o3dls[matlab]', or save it "
            "with -v7"
        ) from error
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            return {name: _plain_value(file[name], file) for name in file if not name.startswith("#")}
    except Exception as error:  # a foreign parser, which raises whatever it meets
        raise InputError(
            f"{path}: is not a readable MATLAB 7.3 file: {error}; it is truncated or damaged"
        ) from error


def _plain_value(node: Any, file: Any) -> Any:
    """Return a group as a dictionary, a data set as an array the way MATLAB shows it: axes turned, characters
    as text, no axis of one.
    """
    import h5py

    if isinstance(node, h5py.Group):
        return {name: _plain_value(node[name], file) for name in node}
    if node.size > LARGEST:
        raise ValueError(f"{node.name} declares {node.size} values")
    if node.attrs.get("MATLAB_empty", 0):
        return np.zeros(0)
    if "MATLAB_object_decode" in node.attrs:  # the numbers there only point at the object
        return Opaque(bytes(node.attrs.get("MATLAB_class", b"object")).decode("latin-1"))
    values = np.asarray(node[()]).T
    if values.dtype == h5py.ref_dtype:
        return [_plain_value(file[reference], file) for reference in values.ravel()]
    if node.attrs.get("MATLAB_class", b"") == b"char":
        return "".join(chr(code) for code in values.ravel())
    return values.squeeze()


def at(tree: Mapping[str, Any], where: str) -> Any:
    """Return the value at `a.b.c`, or None where a step is missing; a MATLAB object on the way is the
    value.
    """
    value: Any = tree
    for name in where.split("."):
        if isinstance(value, Opaque):
            return value
        if not isinstance(value, Mapping) or name not in value:
            return None
        value = value[name]
    return value


def numbers(
    path: Path, tree: Mapping[str, Any], where: str, width: int | None = None
) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    """Return numbers at `a.b.c`, (n,) or (n, width); None where there are none. Raises InputError where they
    have another shape.
    """
    value = at(tree, where)
    if isinstance(value, Opaque):
        raise InputError(
            f"{path}: {where} is, or lies in, a MATLAB object of class {value.of}, which only MATLAB reads; "
            "save it there as a struct of plain arrays: struct('X', t.X, 'Triangulation', t.Triangulation) "
            "for a TriRep, double(x) for numbers"
        )
    if value is None or np.size(value) == 0:
        return None
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"{path}: {where} holds no plain numbers; OpenEP must save it as a struct of arrays, not as "
            "an object"
        ) from None
    array = array.reshape(-1) if width is None else np.atleast_2d(array)
    if width is not None and array.shape[1] != width:
        raise InputError(f"{path}: {where} has shape {np.shape(value)}: must be n x {width}")
    return array
