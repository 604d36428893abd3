"""Selected inversion: the entries of H^-1 where H has blocks, from its supernodal Cholesky factor.

K. Takahashi, J. Fagan, M.-S. Chin, "Formation of a sparse bus impedance matrix and its application to short circuit
study", 1973: on the pattern of L the entries of S = H^-1 follow from each other, from the last column to the first,
and no other entry is needed. For one supernode with columns J and rows R below them (L. Lin, C. Yang, J. Meza, J. Lu,
L. Ying, W. E, "SelInv", ACM TOMS 37(4), 2011), with Y = L_RJ L_JJ^-1,

    S_RJ = -S_RR Y        S_JJ = (L_JJ L_JJ^T)^-1 + Y^T S_RR Y

S_RR is part of what the parent supernode has: R is within its columns and rows. The cost is that of a few
factorizations, whatever the number of variables (for SLAM: M. Kaess, F. Dellaert, "Covariance recovery from a square
root information matrix for data association", RAS 57(12), 2009).
"""

from __future__ import annotations

import numpy as np
from cvxopt import blas, lapack

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.covariance.supernodes import Supernodes, factorize
from slamcli.solver.pattern import BlockPattern


def selected_inverse(pattern: BlockPattern, permutation: IndexArray, values: Array) -> Array:
    """Entries of the inverse of a positive definite matrix on the matrix's own block pattern.

    Parameters
    ----------
    pattern
        Of the matrix.
    permutation
        Elimination order of its scalar rows.
    values
        (pattern.stored,) its stored values.

    Returns
    -------
    (pattern.stored,) array
        The inverse's entries in the same layout: the blocks of the pattern, diagonal blocks in full.

    Raises
    ------
    NotPositiveDefiniteError
        If the matrix is not positive definite.
    """
    if pattern.dimension == 0:
        return np.zeros(pattern.stored)
    factor = factorize(pattern, permutation, values)
    invert(factor)
    return entries(factor, pattern.scalar_rows, pattern.scalar_columns)


def invert(factor: Supernodes) -> None:
    """Replace the panels of L by those of the inverse, [S_JJ; S_RJ], in place."""
    panels = np.frombuffer(factor.panels)
    parents = factor.parents()
    children = np.bincount(parents[parents >= 0], minlength=len(parents)).tolist()
    fronts: dict[int, tuple[IndexArray, Array]] = {}  # rows and inverse of supernodes whose children are to come
    widths, heights, bases = factor.widths.tolist(), factor.heights.tolist(), factor.bases.tolist()
    first, parent = factor.row_starts.tolist(), parents.tolist()
    for k in range(len(heights) - 1, -1, -1):
        width, height, base = widths[k], heights[k], bases[k]
        rows = factor.rows[first[k] : first[k + 1]]
        panel = panels[base : base + width * height].reshape(width, height).T
        front = np.empty((height, height))
        own = front[:width, :width]
        if height > width:
            rest = front[width:, width:]
            _ancestors(rest, *fronts[parent[k]], rows[width:])
            children[parent[k]] -= 1
            if not children[parent[k]]:
                del fronts[parent[k]]
            blas.trsm(
                factor.panels,
                factor.panels,
                side="R",
                m=height - width,
                n=width,
                ldA=height,
                ldB=height,
                offsetA=base,
                offsetB=base + width,
            )
            solved = panel[width:]
            negative = rest @ solved
            lapack.potri(factor.panels, n=width, ldA=height, offsetA=base)
            own[:] = _symmetric(panel[:width] + solved.T @ negative)
            np.negative(negative, out=front[width:, :width])
            np.negative(negative.T, out=front[:width, width:])
        else:
            lapack.potri(factor.panels, n=width, ldA=height, offsetA=base)
            own[:] = _symmetric(panel)
        panel[:] = front[:, :width]
        if children[k]:
            fronts[k] = rows, front


def entries(inverse: Supernodes, rows: IndexArray, columns: IndexArray) -> Array:
    """Entries of the inverse at scalar rows and columns of H that are on the pattern of L (or its transpose's)."""
    position = np.empty(len(inverse.permutation), dtype=np.intp)
    position[inverse.permutation] = np.arange(len(position))
    a, b = position[rows], position[columns]
    early, late = np.minimum(a, b), np.maximum(a, b)
    node = np.repeat(np.arange(len(inverse.heights)), inverse.widths)[early]
    keys = inverse.rows + np.repeat(np.arange(len(inverse.heights)), inverse.heights) * len(position)
    row = np.searchsorted(keys, late + node * len(position)) - inverse.row_starts[node]
    column = early - inverse.starts[node]
    return np.frombuffer(inverse.panels)[inverse.bases[node] + column * inverse.heights[node] + row]


def _ancestors(out: Array, rows: IndexArray, front: Array, wanted: IndexArray) -> None:
    """Copy the part of a front that belongs to some of its rows."""
    place = np.searchsorted(rows, wanted)
    if place[-1] - place[0] == len(place) - 1:
        out[:] = front[place[0] : place[-1] + 1, place[0] : place[-1] + 1]
    else:
        out[:] = front[place[:, None], place]


def _symmetric(lower: Array) -> Array:
    """The symmetric matrix with this lower triangle."""
    return np.tril(lower) + np.tril(lower, -1).T
