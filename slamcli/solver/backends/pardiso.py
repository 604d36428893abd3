"""MKL Pardiso through pypardiso (an optional extra): Cholesky of a real symmetric positive definite matrix."""

from __future__ import annotations

import numpy as np
from pypardiso import PyPardisoSolver
from pypardiso.pardiso_wrapper import PyPardisoError
from scipy.sparse import csr_matrix

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.backends.protocol import NotPositiveDefiniteError
from slamcli.solver.pattern import BlockPattern

_POSITIVE_DEFINITE = 2
_ANALYZE, _FACTORIZE, _SOLVE = 11, 22, 33


class Pardiso:
    """L L^T of the upper triangle, in our elimination order."""

    def __init__(self, pattern: BlockPattern, permutation: IndexArray) -> None:
        position = np.empty_like(permutation)
        position[permutation] = np.arange(len(permutation))
        self._order = permutation
        rows, columns = position[pattern.scalar_rows], position[pattern.scalar_columns]
        upper = (pattern.weight == 2.0) | (pattern.scalar_rows <= pattern.scalar_columns)
        low, high = np.minimum(rows, columns)[upper], np.maximum(rows, columns)[upper]
        numbers = np.arange(1, pattern.stored + 1, dtype=np.float64)[upper]
        shape = (pattern.dimension, pattern.dimension)
        self._matrix = csr_matrix((numbers, (low, high)), shape=shape)
        self._matrix.sort_indices()
        self._source = self._matrix.data.astype(np.intp) - 1
        self._matrix.data = np.ones(len(self._source))
        self._solver = PyPardisoSolver(mtype=_POSITIVE_DEFINITE)
        self._solver.set_iparm(5, 0)  # the solution goes to its own array
        self._natural = np.zeros((pattern.dimension, 1))
        self._call(_ANALYZE, self._natural)

    def factorize(self, values: Array) -> None:
        """Numeric factorization."""
        self._matrix.data = values[self._source]
        try:
            self._call(_FACTORIZE, self._natural)
        except PyPardisoError as error:
            raise NotPositiveDefiniteError(str(error)) from None

    def solve(self, rhs: Array) -> Array:
        """Solution of A x = rhs."""
        out = np.empty_like(rhs)
        out[self._order] = self._call(_SOLVE, rhs[self._order].reshape(-1, 1)).ravel()
        return out

    def _call(self, phase: int, rhs: Array) -> Array:
        self._solver.set_phase(phase)
        return np.asarray(self._solver._call_pardiso(self._matrix, rhs))
