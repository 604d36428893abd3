"""BLAS on a corner of a larger matrix, in place.

``scipy.linalg.blas`` copies a matrix whose columns do not follow each other without a gap. A state that grows lives in
the corner of a larger array, so its columns have gaps: the same routines are called here at their addresses, which
``scipy.linalg.cython_blas`` publishes, with the leading dimension that such a corner has.

Matrices are float64 in column order (the first index runs fastest); only the lower triangle of a symmetric one is
read or written.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

from scipy.linalg import cython_blas

from slamcli.models.base import Array

_LOWER, _PLAIN, _TRANSPOSED, _RIGHT = b"L", b"N", b"T", b"R"
_ONE, _MINUS_ONE = ctypes.c_double(1.0), ctypes.c_double(-1.0)


def _routine(name: str, arguments: int) -> Callable[..., None]:
    """A BLAS routine as a function of addresses."""
    capsule = cython_blas.__pyx_capi__[name]
    python = ctypes.pythonapi
    python.PyCapsule_GetName.restype, python.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    python.PyCapsule_GetPointer.restype = ctypes.c_void_p
    python.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    address = python.PyCapsule_GetPointer(capsule, python.PyCapsule_GetName(capsule))
    prototype = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)
    return prototype(address)


_dsyrk, _dsyr2k, _dtrsm = _routine("dsyrk", 10), _routine("dsyr2k", 12), _routine("dtrsm", 11)


def subtract_square(matrix: Array, factor: Array) -> None:
    """C -= V V^T on the lower triangle of C (n, n), with V (n, k)."""
    (n, k), one = factor.shape, ctypes.byref
    rows, columns = ctypes.c_int(n), ctypes.c_int(k)
    v, c = _column_order(factor), _column_order(matrix)
    _dsyrk(_LOWER, _PLAIN, one(rows), one(columns), one(_MINUS_ONE), v[0], one(v[1]), one(_ONE), c[0], one(c[1]))


def subtract_symmetric_product(matrix: Array, left: Array, right: Array) -> None:
    """C -= A B^T + B A^T on the lower triangle of C (n, n), with A and B (n, k)."""
    (n, k), one = left.shape, ctypes.byref
    rows, columns = ctypes.c_int(n), ctypes.c_int(k)
    a, b, c = _column_order(left), _column_order(right), _column_order(matrix)
    _dsyr2k(
        *(_LOWER, _PLAIN, one(rows), one(columns), one(_MINUS_ONE)),
        *(a[0], one(a[1]), b[0], one(b[1]), one(_ONE), c[0], one(c[1])),
    )


def divide_by_transpose(rows: Array, lower: Array) -> None:
    """W <- W L^-T in place, with W (n, k) and the lower triangle of L (k, k)."""
    (n, k), one = rows.shape, ctypes.byref
    height, width = ctypes.c_int(n), ctypes.c_int(k)
    w, factor = _column_order(rows), _column_order(lower)
    _dtrsm(
        *(_RIGHT, _LOWER, _TRANSPOSED, _PLAIN, one(height), one(width), one(_ONE)),
        *(factor[0], one(factor[1]), w[0], one(w[1])),
    )


def _column_order(matrix: Array) -> tuple[int, ctypes.c_int]:
    """Address and leading dimension of a matrix in column order."""
    down, right = matrix.strides
    assert (down == 8 or matrix.shape[0] <= 1) and right % 8 == 0 and matrix.dtype == float
    return matrix.ctypes.data, ctypes.c_int(max(right // 8, matrix.shape[0], 1))
