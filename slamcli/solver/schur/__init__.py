"""The Schur complement: points are eliminated block by block, what is left is a small system of cameras (or poses)."""

from slamcli.solver.schur.complement import SchurFactorization
from slamcli.solver.schur.conjugate_gradients import NotSolvedError
from slamcli.solver.schur.implicit import ImplicitSchur
from slamcli.solver.schur.selection import ImplicitSelection, Selection, select
from slamcli.solver.schur.structure import Structure

__all__ = [
    "ImplicitSchur",
    "ImplicitSelection",
    "NotSolvedError",
    "SchurFactorization",
    "Selection",
    "Structure",
    "select",
]
