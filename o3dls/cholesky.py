"""Cholesky factors and inverses by SciPy's LAPACK, called directly: its wrappers for Python keep the
interpreter's lock, and fits that run side by side would wait for each other.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import CFUNCTYPE, POINTER, byref, c_char_p, c_int, c_void_p

import numpy as np
from numba import njit
from numba.extending import get_cython_function_address

from .arrays import Array


def _routine(name: str) -> Callable[[Array], int]:
    """A routine that works in place on the lower half of a matrix (n, n) in Fortran's order: its `info`."""
    signature = CFUNCTYPE(None, c_char_p, POINTER(c_int), c_void_p, POINTER(c_int), POINTER(c_int))
    call = signature(get_cython_function_address("scipy.linalg.cython_lapack", name))

    def run(matrix: Array) -> int:
        size, info = c_int(len(matrix)), c_int()
        call(b"L", byref(size), matrix.ctypes.data, byref(size), byref(info))
        return info.value

    return run


_potrf, _potri = _routine("dpotrf"), _routine("dpotri")


def factor_and_inverse(matrix: Array) -> tuple[Array, Array, int]:
    """Cholesky factor (n, n), lower and zero above, of a symmetric matrix (n, n), its inverse (n, n), and 0;
    or the first leading minor that is not positive, and nothing of use.
    """
    factor = np.array(matrix, order="F")
    if minor := _potrf(factor):
        return factor, factor, minor
    inverse = factor.copy(order="F")
    _potri(inverse)
    _complete(factor, inverse)
    return factor, inverse, 0


@njit(cache=True, nogil=True)
def _complete(factor, inverse):  # type: ignore[no-untyped-def]
    """Fill the upper halves, where LAPACK leaves what was there: of the factor with zeros, of the inverse
    with its lower half.
    """
    for j in range(len(factor)):
        for i in range(j):
            factor[i, j] = 0.0
            inverse[i, j] = inverse[j, i]
