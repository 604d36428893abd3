"""Sparse Cholesky factorizations behind one small protocol, loaded only when they are chosen."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.pattern import BlockPattern

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


def make(name: str, pattern: BlockPattern, permutation: IndexArray) -> Factorization:
    """The backend of a name for a pattern and an elimination order of its scalar rows.

    Raises
    ------
    UsageError
        If its library is not installed.
    """
    if name == "cholmod":
        from slamcli.solver.backends.cholmod import Cholmod

        return Cholmod(pattern, permutation)
    if name == "superlu":
        from slamcli.solver.backends.superlu import SuperLU

        return SuperLU(pattern, permutation)
    if name == "pardiso":
        try:
            from slamcli.solver.backends.pardiso import Pardiso
        except ImportError:
            hint = ("  pip install 'slamcli[pardiso]'",)
            raise UsageError("linear solver pardiso is not installed", hint) from None
        return Pardiso(pattern, permutation)
    raise UsageError(f"linear solver {name!r} does not exist")
