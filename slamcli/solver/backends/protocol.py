"""What a sparse Cholesky factorization is to the solver."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from slamcli.models.base import Array

#: A pivot below this share of the largest one is rounding (the worst of the standard sets has 1.6e-11).
ROUNDING = 1e-15


class NotPositiveDefiniteError(ArithmeticError):
    """A pivot of the factorization was not positive."""


class Factorization(Protocol):
    """A sparse Cholesky factorization of matrices of one pattern.

    Symbolic analysis happens in the constructor, once; ``factorize`` and ``solve`` reuse it.
    """

    def factorize(self, values: Array) -> None:
        """Factorize the matrix of these stored values; raises NotPositiveDefiniteError."""

    def solve(self, rhs: Array) -> Array:
        """Solution for one right-hand side with the current factor."""


def require_positive(pivots: Array) -> None:
    """Check the pivots d of L D L^T (the squares of the diagonal of L in L L^T).

    A pivot that is rounding beside the largest one means a singular matrix, whatever its sign.

    Raises
    ------
    NotPositiveDefiniteError
        If one is not clearly positive.
    """
    smallest, largest = float(pivots.min(initial=np.inf)), float(pivots.max(initial=0.0))
    if not smallest > ROUNDING * largest:
        raise NotPositiveDefiniteError(f"the smallest pivot is {smallest:.1e}, the largest {largest:.1e}")
