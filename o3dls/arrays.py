"""Types of arrays: double precision and 64-bit indices, everywhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
TINY = 1e-300  # keeps a denominator, or the argument of a logarithm, from being zero
ROUNDING = 1e-12  # relative: what rounding may make of a number
