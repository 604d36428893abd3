"""A Cholesky factor as supernodes: neighbouring columns of L with the same rows below them, as dense panels.

Supernodes make sparse elimination dense: a panel holds the triangle L_JJ of its columns J on top and, below it, L_RJ
of the rows R that they share. The first of R is a column of the parent in the tree of supernodes, and all of R is
within the parent's columns and rows (Liu 1990, "The role of elimination trees in sparse factorization").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from cvxopt import matrix

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.backends.cholmod import supernodal_factor
from slamcli.solver.pattern import BlockPattern


@dataclass(frozen=True, eq=False)
class Supernodes:
    """Supernodal factor of H[p][:, p] = L L^T.

    Attributes
    ----------
    permutation
        (n,) p: the row of H that is row k of L.
    starts
        (s + 1,) first column of each supernode, and n.
    heights
        (s,) rows of each panel: its columns and the rows below them.
    row_starts
        (s + 1,) where the rows of each panel begin in ``rows``.
    rows
        Rows of all panels in L's order, ascending in each.
    bases
        (s + 1,) where each panel begins in ``panels``.
    panels
        All panels one after the other, each ``heights[k]`` x its columns, column by column: cvxopt's dense matrix,
        so that its BLAS works in place. What is above the diagonal of a triangle is zero.
    """

    permutation: IndexArray
    starts: IndexArray
    heights: IndexArray
    row_starts: IndexArray
    rows: IndexArray
    bases: IndexArray
    panels: matrix

    @property
    def widths(self) -> IndexArray:
        """(s,) columns of each supernode."""
        return np.diff(self.starts)

    def parents(self) -> IndexArray:
        """(s,) the supernode whose columns hold the first row below each, -1 for roots."""
        below = self.widths < self.heights
        parent = np.full(len(self.heights), -1, dtype=np.intp)
        first = self.rows[(self.row_starts[:-1] + self.widths)[below]]
        parent[below] = np.searchsorted(self.starts, first, side="right") - 1
        return parent


def factorize(pattern: BlockPattern, permutation: IndexArray, values: Array) -> Supernodes:
    """Factorize the matrix of a pattern's stored values in an elimination order of its scalar rows.

    Raises
    ------
    NotPositiveDefiniteError
        If it is not positive definite.
    """
    order, columns, rows, entries = supernodal_factor(pattern, permutation, values)
    dimension = len(order)
    counts = np.diff(columns)
    # a column continues a supernode if the one before it has exactly its rows and its own diagonal
    below = rows[np.minimum(columns[:-1] + 1, len(rows) - 1)]  # first row below the diagonal, where there is one
    continues = (counts[:-1] == counts[1:] + 1) & (below[:-1] == np.arange(1, dimension))
    first = np.flatnonzero(np.concatenate([[True], ~continues]))
    starts = np.append(first, dimension)
    widths, heights = np.diff(starts), counts[first]
    bases = np.concatenate([[0], np.cumsum(widths * heights)])
    row_starts = np.concatenate([[0], np.cumsum(heights)])
    shared = rows[_ranges(columns[first], heights)]
    # entry k of column j stands k rows below the diagonal of that column's panel
    within = np.arange(dimension) - np.repeat(first, widths)
    diagonal = np.repeat(bases[:-1], widths) + within * (np.repeat(heights, widths) + 1)
    panels = matrix(0.0, (int(bases[-1]), 1))
    np.frombuffer(panels)[np.arange(len(entries)) + np.repeat(diagonal - columns[:-1], counts)] = entries
    return Supernodes(order, starts, heights, row_starts, shared, bases, panels)


def _ranges(start: IndexArray, length: IndexArray) -> IndexArray:
    """The ranges ``start[k] : start[k] + length[k]``, one after the other."""
    ends = np.cumsum(length)
    return np.arange(int(ends[-1])) + np.repeat(start - ends + length, length)
