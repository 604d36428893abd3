"""Symbolic analysis of a Cholesky factorization on the block graph: what elimination in some order costs, unfactorized.

``analyze`` gives the elimination tree and the column counts, hence nonzeros, flops and the tree's height;
``supernodes`` the supernodes and front sizes; ``row_structure`` the rows of each supernode, hence the pattern of L.
"""

from slamcli.solver.symbolic.analysis import SymbolicAnalysis, analyze
from slamcli.solver.symbolic.sparsity import ReducedSystem, Sparsity
from slamcli.solver.symbolic.structure import RowStructure, row_structure
from slamcli.solver.symbolic.supernodes import Supernodes, supernodes

__all__ = [
    "ReducedSystem",
    "RowStructure",
    "Sparsity",
    "Supernodes",
    "SymbolicAnalysis",
    "analyze",
    "row_structure",
    "supernodes",
]
