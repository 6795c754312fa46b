"""Types of arrays: double precision and 64-bit indices, everywhere."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
TINY = 1e-300  # keeps a denominator, or the argument of a logarithm, from being zero
ROUNDING = 1e-12  # relative: what rounding may make of a number


def masked_in(thing: Any) -> Mask | None:
    """Return where an array, or a list of arrays, is masked; None where nothing is. NumPy gives the numbers
    below a mask as if they were there.
    """
    parts = thing if isinstance(thing, list | tuple) else [thing]
    if not any(isinstance(part, np.ma.MaskedArray) for part in parts):
        return None
    mask = np.asarray(np.ma.getmaskarray(np.ma.array(thing)), dtype=bool)
    return mask if mask.any() else None


def without_masked(thing: Any) -> NDArray[Any]:
    """Return an array in which masked numbers are NaN and masked texts are empty."""
    values = np.array(np.ma.getdata(thing) if isinstance(thing, np.ma.MaskedArray) else thing)
    if (mask := masked_in(thing)) is None:
        return values
    return np.where(mask, "", values) if values.dtype.kind in "US" else np.where(mask, np.nan, values)
