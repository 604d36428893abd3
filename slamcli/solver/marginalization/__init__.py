"""Marginalization: remove variables from a graph and keep what they say about the others.

The Schur complement of H onto the kept variables, group by group of removed variables, written back as factors
between pairs of variables, all that files can hold: exactly where that is possible, else with the least
Kullback-Leibler divergence (nonlinear factor recovery).
"""

from slamcli.solver.marginalization.comparison import Comparison, compare, require_same_optimum
from slamcli.solver.marginalization.fill_in import Blocks
from slamcli.solver.marginalization.reduction import SPARSIFICATIONS, Reduction, marginalize
from slamcli.solver.marginalization.selection import removed_by

__all__ = [
    "SPARSIFICATIONS",
    "Blocks",
    "Comparison",
    "Reduction",
    "compare",
    "marginalize",
    "removed_by",
    "require_same_optimum",
]
