"""Cholesky factorization by a Schur complement.

With H = [[A, W], [W^T, V]], V block diagonal with small blocks V_p = L_p L_p^T, and Z_ip = W_ip L_p^-T,

    S = A - sum_p Z_p Z_p^T,    S x = b - sum_p Z_p L_p^-1 c_p,    y_p = L_p^-T (L_p^-1 c_p - Z_p^T x).

(D. Brown, 1958; Triggs, McLauchlan, Hartley, Fitzgibbon, "Bundle Adjustment - A Modern Synthesis", 1999, section 6.1.)
All points are worked on at once. The products Z_ip Z_jp^T of two cameras add up in one matrix product over the points
that both see; where that are few, they are made one by one.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.backends import Factorization, NotPositiveDefiniteError
from slamcli.solver.backends.protocol import ROUNDING
from slamcli.solver.schur.structure import Structure

#: Pairs from which on one matrix product for a block of the complement is faster than one for each pair.
_LONG = 6
#: Pairs that are gathered at a time.
_CHUNK = 8192


class SchurFactorization:
    """Factorization of matrices of a pattern by eliminating an independent set of blocks first.

    Parameters
    ----------
    structure
        What is eliminated.
    reduced
        Factorizes the complement, whose rows and columns are scaled to a diagonal of about 1 before.
    """

    def __init__(self, structure: Structure, reduced: Factorization) -> None:
        self.structure, self._reduced = structure, reduced
        self._padded = bool((structure.links == structure.pattern.stored).any())
        lengths = np.diff(structure.runs)
        self._long, self._short = np.flatnonzero(lengths >= _LONG), np.flatnonzero(lengths < _LONG)
        self._factor: list[list[Array]] = []
        self._z = np.empty(structure.links.shape)
        self._scale = np.empty(structure.reduced.dimension)

    def factorize(self, values: Array) -> None:
        """Numeric factorization; raises NotPositiveDefiniteError."""
        structure = self.structure
        self._factor = _cholesky(values, structure.points)
        source = np.append(values, 0.0) if self._padded else values
        self._divide(np.take(source, structure.links))
        complement = np.zeros(structure.reduced.stored + 1)
        complement[structure.to_reduced] = values[structure.from_hessian]
        diagonal = complement[structure.reduced.diagonal]
        if not (diagonal > 0.0).all():
            raise NotPositiveDefiniteError("the diagonal is not positive")
        self._subtract_products(complement)
        self._scale = 1.0 / np.sqrt(diagonal)
        reduced = structure.reduced
        scaled = complement[:-1] * self._scale[reduced.scalar_rows] * self._scale[reduced.scalar_columns]
        self._reduced.factorize(scaled)

    def solve(self, rhs: Array) -> Array:
        """Solution of H x = rhs with the current factor."""
        structure = self.structure
        inner = self._forward(rhs[structure.gone_rows].T)
        gathered = np.take(inner, structure.point, axis=1)  # (size, m)
        side = np.append(rhs[structure.kept_rows], 0.0)
        runs = structure.camera_runs.tolist()
        rows = structure.camera_rows
        z = self._z
        by_link = np.ascontiguousarray(gathered.T)
        for camera, (begin, end) in enumerate(pairwise(runs)):
            if end > begin:
                side[rows[camera]] -= by_link[begin:end].ravel() @ z[begin:end].reshape(-1, structure.width)
        outer = self._scale * self._reduced.solve(self._scale * side[:-1])
        padded = np.append(outer, 0.0)
        for camera, (begin, end) in enumerate(pairwise(runs)):
            if end > begin:
                np.matmul(
                    z[begin:end].reshape(-1, structure.width), padded[rows[camera]], out=by_link[begin:end].reshape(-1)
                )
        count = len(structure.gone)
        for k in range(structure.size):
            inner[k] -= np.bincount(structure.point, by_link[:, k], minlength=count)
        out = np.empty(len(rhs))
        out[structure.kept_rows] = outer
        out[structure.gone_rows] = self._backward(inner).T
        return out

    def _divide(self, links: Array) -> None:
        """Z^T = L^-1 W^T for the blocks of W^T, (m, size, width)."""
        structure = self.structure
        inverse = np.empty((len(structure.gone), structure.size, structure.size))
        for column in range(structure.size):
            unit = np.zeros((structure.size, len(structure.gone)))
            unit[column] = 1.0
            inverse[:, :, column] = self._forward(unit).T
        np.matmul(np.take(inverse, structure.point, axis=0), links, out=self._z)

    def _subtract_products(self, complement: Array) -> None:
        """Subtract the products Z_p Z_p^T from the values of the complement."""
        structure, width = self.structure, self.structure.width
        for target, (begin, end) in zip(structure.diagonal_targets, pairwise(structure.camera_runs), strict=True):
            own = self._z[begin:end].reshape(-1, width)
            complement[target] -= own.T @ own
        runs = structure.runs
        for chosen, one_by_one in ((self._long, False), (self._short, True)):
            lengths = runs[chosen + 1] - runs[chosen]
            cuts = np.searchsorted(np.cumsum(lengths), np.arange(_CHUNK, int(lengths.sum()) + _CHUNK, _CHUNK))
            for blocks in np.split(chosen, np.unique(cuts)):
                if len(blocks) == 0:
                    continue
                length = runs[blocks + 1] - runs[blocks]
                ends = np.cumsum(length)
                pairs = np.arange(int(ends[-1])) + np.repeat(runs[blocks] - ends + length, length)
                one = np.take(self._z, structure.left[pairs], axis=0)
                two = np.take(self._z, structure.right[pairs], axis=0)
                if one_by_one:
                    product = np.matmul(one.transpose(0, 2, 1), two)
                    target = structure.targets[np.repeat(blocks, length)]
                    np.subtract.at(complement, target.ravel(), product.ravel())
                    continue
                one, two = one.reshape(-1, width), two.reshape(-1, width)
                product = np.empty((len(blocks), width, width))
                bounds = (structure.size * np.concatenate([[0], ends])).tolist()
                for k, (begin, end) in enumerate(pairwise(bounds)):
                    np.matmul(one[begin:end].T, two[begin:end], out=product[k])
                target = structure.targets[blocks]
                complement[target] -= product  # (padding collects what is no matter)

    def _forward(self, right: Array) -> Array:
        """L^-1 b of all points, (size, p)."""
        out = right.copy()
        for k, row in enumerate(self._factor):
            for j in range(k):
                out[k] -= row[j] * out[j]
            out[k] *= row[k]
        return out

    def _backward(self, right: Array) -> Array:
        """L^-T b of all points, (size, p)."""
        out = right.copy()
        for k in reversed(range(len(self._factor))):
            for j in range(k + 1, len(self._factor)):
                out[k] -= self._factor[j][k] * out[j]
            out[k] *= self._factor[k][k]
        return out


def _cholesky(values: Array, places: IndexArray) -> list[list[Array]]:
    """Rows of the Cholesky factors of all small blocks, entry by entry (p,); of the diagonal, the reciprocals.

    Raises
    ------
    NotPositiveDefiniteError
        If a pivot is not clearly positive beside the diagonal entry that it comes from.
    """
    factor: list[list[Array]] = []
    for k in range(len(places)):
        row: list[Array] = []
        for j in range(k):
            entry = values[places[k, j]]
            for i in range(j):
                entry -= row[i] * factor[j][i]
            entry *= factor[j][j]
            row.append(entry)
        diagonal = values[places[k, k]]
        pivot = diagonal - sum(entry * entry for entry in row)
        if not (pivot > ROUNDING * diagonal).all():
            raise NotPositiveDefiniteError("a block that is to be eliminated is not positive definite")
        row.append(1.0 / np.sqrt(pivot))
        factor.append(row)
    return factor
