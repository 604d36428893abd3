"""LAPACK's Cholesky of the whole matrix, through cvxopt: for small systems, and where most blocks are there."""

from __future__ import annotations

import numpy as np
from cvxopt import lapack, matrix

from slamcli.models.base import Array
from slamcli.solver.backends.protocol import NotPositiveDefiniteError, require_positive
from slamcli.solver.pattern import BlockPattern


class Dense:
    """L L^T of a matrix of a block pattern, zeros and all; there is nothing to order."""

    def __init__(self, pattern: BlockPattern) -> None:
        size = pattern.dimension
        self._place = pattern.scalar_rows + size * pattern.scalar_columns  # column by column, upper triangle
        self._matrix = matrix(0.0, (size, size))
        self._view = np.asarray(self._matrix).reshape(-1, order="F")

    def factorize(self, values: Array) -> None:
        """Numeric factorization."""
        self._view[:] = 0.0
        self._view[self._place] = values
        try:
            lapack.potrf(self._matrix, uplo="U")
        except ArithmeticError as error:
            raise NotPositiveDefiniteError(f"the leading minor of order {error} is not positive") from None
        require_positive(np.square(self._view[:: self._matrix.size[0] + 1]))

    def solve(self, rhs: Array) -> Array:
        """Solution of A x = rhs."""
        solution = matrix(rhs)
        lapack.potrs(self._matrix, solution, uplo="U")
        return np.frombuffer(solution)
