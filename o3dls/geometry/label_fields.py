"""Fields whose numbers are names: a region, a tag, a class. No mean of two of them is a third."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Ints
from .surface import interpolated

MOST = 64  # distinct labels; a field with more measures something
WORDS = {"label", "region", "tag", "id", "scar", "class", "classes", "material"}


def is_label(name: str, values: NDArray[Any]) -> bool:
    """Return whether a field holds labels: whole numbers of an integer type, or by its name (`region`,
    `elemTag`, `scar_class`) where all its values are whole and at most MOST differ, as programs write that
    know floating-point numbers alone.
    """
    if values.dtype.kind in "iu":
        return True
    if values.dtype.kind != "f" or values.ndim != 1 or not _names_label(name):
        return False
    with np.errstate(invalid="ignore"):
        whole = bool(np.isfinite(values).all() and (values == np.round(values)).all())
    return whole and len(np.unique(values)) <= MOST


def _names_label(name: str) -> bool:
    parts = [part.lower() for part in re.split(r"[^a-zA-Z]+|(?<=[a-z])(?=[A-Z])", name)]
    return any(part in WORDS or part.removesuffix("s") in WORDS for part in parts)


def read_at(name: str, values: Array, corners: Ints, weights: Array) -> Array:
    """Return the values (n, ...) of a field at places of barycentric weights (n, d) among vertices (n, d):
    interpolated, or of labels the one of most weight, of equal ones the first.
    """
    if not is_label(name, values):
        return interpolated(values, corners, weights)
    found = values[corners]
    shares = (weights[:, None, :] * (found[:, :, None] == found[:, None, :])).sum(axis=2)
    most = shares.argmax(axis=1)[:, None]
    return np.take_along_axis(found, most, axis=1)[:, 0].astype(np.float64)
