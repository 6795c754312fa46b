"""Cholesky factors and inverses by SciPy's LAPACK, called directly: its wrappers for Python keep the
interpreter's lock, and threads would wait for each other.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import CFUNCTYPE, byref, c_double, c_int, c_void_p
from typing import Any

import numpy as np
from numba import njit
from numba.extending import get_cython_function_address

from .arrays import Array

HALVED = 96  # rows from which a triangle is inverted by halves, in half of LAPACK's time


def _find_routine(library: str, name: str, arguments: int) -> Callable[..., int]:
    """Find a routine of BLAS or LAPACK that takes so many arguments. A matrix stands for two: the place of a
    block in Fortran's order, and the length of its columns. The last one may be `info`, which is returned.
    """
    address = get_cython_function_address(f"scipy.linalg.cython_{library}", name)
    routine = CFUNCTYPE(None, *[c_void_p] * arguments)(address)

    def call(*given: bytes | int | float | Array) -> int:
        passed = list[Any]()
        for one in given:
            if isinstance(one, np.ndarray):
                passed += [one.ctypes.data, byref(c_int(one.strides[1] // one.itemsize))]
            elif isinstance(one, bytes):
                passed.append(one)
            else:
                passed.append(byref(c_double(one) if isinstance(one, float) else c_int(one)))
        info = c_int()
        routine(*passed, *[byref(info)] * (arguments - len(passed)))
        return info.value

    return call


_potrf, _lauum = _find_routine("lapack", "dpotrf", 5), _find_routine("lapack", "dlauum", 5)
_trtri, _trmm = _find_routine("lapack", "dtrtri", 6), _find_routine("blas", "dtrmm", 11)


def factor_and_inverse(matrix: Array) -> tuple[Array, Array, int]:
    """Return the Cholesky factor (n, n), lower and zero above, of a symmetric matrix (n, n), its inverse (n,
    n), and 0; or the order of the first leading minor that is not positive, and nothing of use.
    """
    factor = np.array(matrix, order="F")
    size = len(factor)
    if minor := _potrf(b"L", size, factor):
        return factor, factor, minor
    inverse = factor.copy(order="F")
    _invert_triangle(inverse)
    _lauum(b"L", size, inverse)  # of the factor's inverse w: w^T w
    _complete_halves(factor, inverse)
    return factor, inverse, 0


def _invert_triangle(lower: Array) -> None:
    """Invert a lower triangle (n, n) in place: the triangles a and c on its diagonal, and b below a, which
    becomes -c^-1 b a^-1.
    """
    size = len(lower)
    if size < HALVED:
        _trtri(b"L", b"N", size, lower)
        return
    h = size // 2
    a, b, c = lower[:h, :h], lower[h:, :h], lower[h:, h:]
    _invert_triangle(a)
    _invert_triangle(c)
    _trmm(b"R", b"L", b"N", b"N", size - h, h, 1.0, a, b)
    _trmm(b"L", b"L", b"N", b"N", size - h, h, -1.0, c, b)


@njit(cache=True, nogil=True)
def _complete_halves(factor, inverse):  # type: ignore[no-untyped-def]
    """Fill in the upper halves: of the factor with zeros, of the inverse with its lower half."""
    for j in range(len(factor)):
        for i in range(j):
            factor[i, j] = 0.0
            inverse[i, j] = inverse[j, i]
