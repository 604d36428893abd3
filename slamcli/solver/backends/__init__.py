"""Sparse Cholesky factorizations behind one small protocol, loaded only when they are chosen."""

from __future__ import annotations

from slamcli.errors import UsageError
from slamcli.graph.columns import IndexArray
from slamcli.solver.backends.protocol import Factorization, NotPositiveDefiniteError
from slamcli.solver.pattern import BlockPattern

__all__ = ["Factorization", "NotPositiveDefiniteError", "make"]


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
