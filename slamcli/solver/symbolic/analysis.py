"""Elimination tree and column counts of a pattern under an order, and what follows from them: nnz(L), flops, height."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.symbolic.column_counts import column_counts
from slamcli.solver.symbolic.elimination_tree import depths, elimination_tree, postorder


@dataclass(frozen=True, eq=False)
class SymbolicAnalysis:
    """Structure of the factor of a pattern under an elimination order.

    Attributes
    ----------
    order
        (n,) block elimination order: position k holds the block eliminated k-th.
    sizes
        (n,) scalar rows of each block, in the order of elimination.
    parent
        (n,) elimination tree in the order of elimination, -1 for roots.
    counts
        (n,) scalar rows of L in the first scalar column of each block column, its diagonal block included.
    nnz_factor
        Nonzeros of the scalar factor L.
    flops
        Sum of the squared scalar column counts: CHOLMOD's flop count of the factorization.
    """

    order: IndexArray
    sizes: IndexArray
    parent: IndexArray
    counts: IndexArray
    nnz_factor: int
    flops: float

    @cached_property
    def height(self) -> int:
        """Height of the elimination tree: block columns on the longest way from a leaf to a root, 0 without any.

        So many eliminations must follow one another, however many could be done side by side.
        """
        return int(depths(self.parent).max(initial=0))


def analyze(pattern: BlockPattern, order: IndexArray) -> SymbolicAnalysis:
    """Symbolic analysis of a pattern under a block elimination order."""
    sizes = pattern.sizes[order]
    low, high = eliminated_edges(pattern, order)
    parent = elimination_tree(len(order), low, high)
    counts = np.array(column_counts(parent, postorder(parent), low, high, sizes.tolist()), dtype=np.int64)
    # the scalar columns of a block column have counts c, c - 1, ..., c - size + 1
    below = counts - sizes
    nnz = int((sizes * below + sizes * (sizes + 1) // 2).sum())
    c = counts.astype(np.float64)
    s = sizes.astype(np.float64)
    flops = float((s * c * c - c * s * (s - 1) + (s - 1) * s * (2 * s - 1) / 6).sum())
    return SymbolicAnalysis(order, sizes, np.array(parent, dtype=np.intp), counts, nnz, flops)


def eliminated_edges(pattern: BlockPattern, order: IndexArray) -> tuple[IndexArray, IndexArray]:
    """The blocks off the diagonal as positions in the order of elimination, (e,) each: the earlier and the later."""
    position = np.empty(len(order), dtype=np.intp)
    position[order] = np.arange(len(order))
    off = pattern.rows != pattern.columns
    a, b = position[pattern.rows[off]], position[pattern.columns[off]]
    return np.minimum(a, b), np.maximum(a, b)
