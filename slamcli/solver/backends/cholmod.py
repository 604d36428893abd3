"""CHOLMOD's sparse Cholesky, through cvxopt (Chen, Davis, Hager, Rajamanickam 2008)."""

from __future__ import annotations

import numpy as np
from cvxopt import cholmod, matrix, spmatrix

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.backends.protocol import NotPositiveDefiniteError, require_positive
from slamcli.solver.pattern import BlockPattern

_SIMPLICIAL, _SUPERNODAL = 0, 2
_SOLVE_D = 6  # cvxopt's code for solving with the D of L D L^T
#: With fewer blocks off the diagonal than this per column, fronts are so small that the simplicial code is faster
#: (measured on the standard sets: intel_sesync 1.45, kitti_00 1.03 against manhattan 1.56 and city10000 2.07).
_SPARSE = 1.5


class Cholmod:
    """L L^T (supernodal) or L D L^T (simplicial, for very sparse graphs) of the upper triangle."""

    def __init__(self, pattern: BlockPattern, permutation: IndexArray) -> None:
        self._matrix = _expanded(pattern)
        self._values = matrix(0.0, (pattern.stored, 1))
        self._view = np.frombuffer(self._values)
        count = len(pattern.sizes)
        self._mode = _SIMPLICIAL if len(pattern.rows) - count < _SPARSE * count else _SUPERNODAL
        cholmod.options["supernodal"] = self._mode
        cholmod.options["nmethods"] = 1  # eliminate in the given order; by default CHOLMOD tries its own, too
        self._factor = cholmod.symbolic(self._matrix, matrix(permutation), "U")

    def factorize(self, values: Array) -> None:
        """Numeric factorization."""
        self._view[:] = values
        self._matrix.V = self._values
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
