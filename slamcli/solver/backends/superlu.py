"""SuperLU (scipy) as a fallback: an LU factorization in symmetric mode, without pivoting."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.backends.protocol import NotPositiveDefiniteError, require_positive
from slamcli.solver.pattern import BlockPattern


class SuperLU:
    """L U of the permuted full matrix; positive definite where all pivots are positive."""

    def __init__(self, pattern: BlockPattern, permutation: IndexArray) -> None:
        self._order = permutation
        position = np.empty_like(permutation)
        position[permutation] = np.arange(len(permutation))
        rows, columns = position[pattern.scalar_rows], position[pattern.scalar_columns]
        mirrored = pattern.weight == 2.0
        shape = (pattern.dimension, pattern.dimension)
        # number the entries from 1 through the conversion to columns: afterwards they tell where each value belongs
        numbers = np.arange(1, pattern.stored + 1)
        self._matrix = csc_matrix(
            (
                np.concatenate([numbers, numbers[mirrored]]).astype(np.float64),
                (np.concatenate([rows, columns[mirrored]]), np.concatenate([columns, rows[mirrored]])),
            ),
            shape=shape,
        )
        self._matrix.sort_indices()
        self._source = self._matrix.data.astype(np.intp) - 1

    def factorize(self, values: Array) -> None:
        """Numeric (and, as SuperLU has it, symbolic) factorization."""
        self._matrix.data = values[self._source]
        try:
            self._factor = splu(
                self._matrix,
                permc_spec="NATURAL",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise NotPositiveDefiniteError(str(error)) from None
        require_positive(self._factor.U.diagonal())

    def solve(self, rhs: Array) -> Array:
        """Solution of A x = rhs."""
        out = np.empty_like(rhs)
        out[self._order] = self._factor.solve(rhs[self._order])
        return out
