"""Approximate minimum degree of the columns of the Jacobian (COLAMD: Davis, Gilbert, Larimore, Ng 2004)."""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.ordering.adjacency import edges
from slamcli.solver.pattern import BlockPattern


def colamd(pattern: BlockPattern) -> IndexArray:
    """Block elimination order that COLAMD finds on the block structure A of the Jacobian, for H = A^T A.

    A has a row for each pair of variables that a factor joins. That is exact for factors of one or two variables:
    those on the same pair repeat a row, and those of one variable add nothing to A^T A.

    The only COLAMD in reach without a compiler is inside scipy's SuperLU, which orders square regular matrices to
    factorize them. So A gets a unit column for each row and a unit row for each column,

        [ A  I ]
        [ I  0 ]

    whose determinant is 1 up to the sign. The unit columns are the first that COLAMD eliminates, without a trace on
    the others. An incomplete factorization that drops everything leaves little to do but the ordering.
    """
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import spilu

    low, high = edges(pattern)
    rows, count = len(low), len(pattern.sizes)
    number = np.arange(rows)
    row = np.concatenate([number, number, number, rows + np.arange(count)])
    column = np.concatenate([low, high, count + number, np.arange(count)])
    values = np.concatenate([np.full(2 * rows, 0.1), np.ones(rows + count)])
    matrix = csc_matrix((values, (row, column)), shape=(rows + count, rows + count))
    position = spilu(matrix, drop_tol=1.0, fill_factor=1.0, permc_spec="COLAMD").perm_c
    return np.argsort(position[:count])
