"""CHOLMOD's supernodal Cholesky, through cvxopt (Chen, Davis, Hager, Rajamanickam 2008)."""

from __future__ import annotations

import numpy as np
from cvxopt import cholmod, matrix, spmatrix

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.pattern import BlockPattern

_SUPERNODAL = 2


class Cholmod:
    """Supernodal L L^T of the upper triangle."""

    def __init__(self, pattern: BlockPattern, permutation: IndexArray) -> None:
        rows, columns = matrix(pattern.scalar_rows), matrix(pattern.scalar_columns)
        shape = (pattern.dimension, pattern.dimension)
        # cvxopt keeps the entries sorted by column, then row: the order in which the pattern stores its values
        self._matrix = spmatrix(1.0, rows, columns, shape)
        self._values = matrix(0.0, (pattern.stored, 1))
        self._view = np.frombuffer(self._values)
        cholmod.options["supernodal"] = _SUPERNODAL
        self._factor = cholmod.symbolic(self._matrix, matrix(permutation), "U")

    def factorize(self, values: Array) -> None:
        """Numeric factorization."""
        self._view[:] = values
        self._matrix.V = self._values
        try:
            cholmod.numeric(self._matrix, self._factor)
        except ArithmeticError as error:
            raise NotPositiveDefiniteError(str(error)) from None

    def solve(self, rhs: Array) -> Array:
        """Solution of A x = rhs."""
        solution = matrix(rhs)
        cholmod.solve(self._factor, solution)
        return np.frombuffer(solution)
