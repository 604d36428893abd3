"""CHOLMOD's sparse Cholesky, through cvxopt (Chen, Davis, Hager, Rajamanickam 2008)."""

from __future__ import annotations

import sys

import numpy as np
from cvxopt import cholmod, matrix, spmatrix

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.backends.protocol import NotPositiveDefiniteError, require_positive
from slamcli.solver.pattern import BlockPattern

_SIMPLICIAL, _SUPERNODAL = 0, 2
_SOLVE_D = 6  # cvxopt's code for solving with the D of L D L^T
_PERMUTE = 7  # ... and for permuting only
#: With fewer blocks off the diagonal than this per column, fronts are so small that the simplicial code is faster
#: (measured on the standard sets: intel_sesync 1.45, kitti_00 1.03 against manhattan 1.56 and city10000 2.07).
_SPARSE = 1.5
#: Stored values of a matrix, beyond which memory that was freed is given back before the factor takes its own.
_LARGE = 1_000_000


class Cholmod:
    """L L^T (supernodal) or L D L^T (simplicial, for very sparse graphs) of the upper triangle."""

    def __init__(self, pattern: BlockPattern, permutation: IndexArray, supernodal: bool | None = None) -> None:
        self._matrix = _expanded(pattern)
        count = len(pattern.sizes)
        dense = len(pattern.rows) - count >= _SPARSE * count if supernodal is None else supernodal
        self.supernodal = dense
        self._mode = _SUPERNODAL if dense else _SIMPLICIAL
        cholmod.options["supernodal"] = self._mode
        cholmod.options["nmethods"] = 1  # eliminate in the given order; by default CHOLMOD tries its own, too
        self._factor = cholmod.symbolic(self._matrix, matrix(permutation), "U")
        if pattern.stored > _LARGE:
            _release()

    def factorize(self, values: Array) -> None:
        """Numeric factorization."""
        self._matrix.V = matrix(values)
        cholmod.options["supernodal"] = self._mode
        try:
            cholmod.numeric(self._matrix, self._factor)
        except ArithmeticError as error:
            raise NotPositiveDefiniteError(str(error)) from None
        require_positive(self._pivots())

    def _pivots(self) -> Array:
        """The D of L D L^T, which exists for indefinite matrices, too, or the squared diagonal of L."""
        if self._mode == _SUPERNODAL:
            return np.square(np.frombuffer(cholmod.diag(self._factor)))
        inverse = matrix(1.0, (self._matrix.size[0], 1))
        cholmod.solve(self._factor, inverse, _SOLVE_D)
        with np.errstate(divide="ignore"):
            return 1.0 / np.frombuffer(inverse)

    def solve(self, rhs: Array) -> Array:
        """Solution of A x = rhs."""
        solution = matrix(rhs)
        cholmod.solve(self._factor, solution)
        return np.frombuffer(solution)

    def take(self) -> tuple[IndexArray, IndexArray, IndexArray, Array]:
        """Take a supernodal factor out (see ``supernodal_factor``); afterwards nothing is left to solve with."""
        numbers = matrix(np.arange(self._matrix.size[0], dtype=np.float64))
        cholmod.solve(self._factor, numbers, _PERMUTE)
        starts, rows, entries = cholmod.getfactor(self._factor).CCS
        order = np.frombuffer(numbers).astype(np.intp)
        return order, np.frombuffer(starts, np.intp), np.frombuffer(rows, np.intp), np.frombuffer(entries)


def supernodal_factor(
    pattern: BlockPattern, permutation: IndexArray, values: Array
) -> tuple[IndexArray, IndexArray, IndexArray, Array]:
    """The supernodal factor of a matrix itself, with its rows and columns in L's own order.

    L is that of A[p][:, p] = L L^T, where p is the given permutation after CHOLMOD's postorder of the elimination tree.

    Returns
    -------
    permutation
        (n,) p: the row of A that is row k of L.
    starts, rows, entries
        L in compressed columns, rows ascending. It has the explicit zeros of CHOLMOD's relaxed supernodes, so that
        the columns of a supernode have the same rows below it.

    Raises
    ------
    NotPositiveDefiniteError
        If the matrix is not positive definite.
    """
    lower = Cholmod(pattern, permutation, supernodal=True)
    lower.factorize(values)
    return lower.take()


def _release() -> None:
    """Give freed memory back to the system, where the C library can: glibc keeps a tenth of what a large run takes."""
    import ctypes

    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def _expanded(pattern: BlockPattern) -> spmatrix:
    """The scalar matrix of a block pattern, as E^T B E with B the blocks' pattern and E_bk = 1 where row k is in b.

    Several times faster than from the coordinates of its entries. cvxopt keeps entries sorted by column, then row,
    which is the order in which the pattern stores its values.
    """
    count = len(pattern.sizes)
    blocks = spmatrix(1.0, matrix(pattern.rows), matrix(pattern.columns), (count, count))
    owner = matrix(np.repeat(np.arange(count), pattern.sizes))
    membership = spmatrix(1.0, owner, matrix(np.arange(pattern.dimension)), (count, pattern.dimension))
    return membership.T * (blocks * membership)
