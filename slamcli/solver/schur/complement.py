"""Cholesky factorization by a Schur complement.

With H = [[A, W], [W^T, V]], V block diagonal with small blocks V_p = L_p L_p^T, and Z_ip = W_ip L_p^-T,

    S = A - sum_p Z_p Z_p^T,    S x = b - sum_p Z_p L_p^-1 c_p,    y_p = L_p^-T (L_p^-1 c_p - Z_p^T x).

(D. Brown, 1958; Triggs, McLauchlan, Hartley, Fitzgibbon, "Bundle Adjustment - A Modern Synthesis", 1999, section 6.1.)
All points are worked on at once. The products Z_ip Z_jp^T of two cameras add up in one matrix product over the points
that both see; where that are few, they are made one by one.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

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
        lengths = np.diff(structure.runs)
        self._long = _chunks(structure, np.flatnonzero(lengths >= _LONG))
        self._short = _chunks(structure, np.flatnonzero(lengths < _LONG))
        most = max((len(chunk.left) for chunk in (*self._long, *self._short)), default=0)
        self._pairs = np.empty((2, most, structure.size, structure.width))
        self._factor: list[list[Array]] = []
        self._z = np.empty((len(structure.camera), structure.size, structure.width))
        self._scale = np.empty(structure.reduced.dimension)

    def factorize(self, values: Array) -> None:
        """Numeric factorization; raises NotPositiveDefiniteError."""
        structure = self.structure
        self._factor = _cholesky(values, structure.points)
        complement = np.zeros(structure.reduced.stored + 1)
        complement[structure.to_reduced] = values[structure.from_hessian]
        diagonal = complement[structure.reduced.diagonal]
        if not (diagonal > 0.0).all():
            raise NotPositiveDefiniteError("the diagonal is not positive")
        self._divide(values, complement)
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

    def _divide(self, values: Array, complement: Array) -> None:
        """Z^T = L^-1 W^T, camera by camera; from the complement, subtract the products of each camera with itself."""
        structure, width = self.structure, self.structure.width
        inverse = np.empty((len(structure.gone), structure.size, structure.size))
        for column in range(structure.size):
            unit = np.zeros((structure.size, len(structure.gone)))
            unit[column] = 1.0
            inverse[:, :, column] = self._forward(unit).T
        sizes = structure.reduced.sizes.tolist()
        if min(sizes, default=width) < width:
            values = np.concatenate([values, np.zeros(max(width, structure.size))])
        for camera, (begin, end) in enumerate(pairwise(structure.camera_runs.tolist())):
            if begin == end:
                continue
            own = self._z[begin:end]
            np.matmul(inverse[structure.point[begin:end]], structure.links[camera].read(values), out=own)
            own[:, :, sizes[camera] :] = 0.0
            own = own.reshape(-1, width)
            complement[structure.diagonal_targets[camera]] -= own.T @ own  # (padding collects what is no matter)

    def _subtract_products(self, complement: Array) -> None:
        """Subtract the products of two cameras from the values of the complement."""
        size, width = self.structure.size, self.structure.width
        for chunk in self._long:
            one, two = (pairs.reshape(-1, width) for pairs in self._gathered(chunk))
            product = np.empty((len(chunk.targets), width, width))
            for k, (begin, end) in enumerate(pairwise((size * chunk.runs).tolist())):
                np.dot(one[begin:end].T, two[begin:end], out=product[k])
            complement[chunk.targets] -= product
        for chunk in self._short:
            one, two = self._gathered(chunk)
            product = np.matmul(one.transpose(0, 2, 1), two)
            targets = np.repeat(chunk.targets, np.diff(chunk.runs), axis=0)
            np.subtract.at(complement, targets.ravel(), product.ravel())

    def _gathered(self, chunk: _Chunk) -> Iterator[Array]:
        """Z^T of both links of each pair, (q, size, width)."""
        for links, room in zip((chunk.left, chunk.right), self._pairs, strict=True):
            # (the mode matters: with the default one numpy takes into a copy of the room)
            yield np.take(self._z, links, axis=0, out=room[: len(links)], mode="clip")

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


class _Chunk(NamedTuple):
    """Pairs of links that are multiplied together: (q,) links, (b + 1,) runs of one block each, (b, width, width)."""

    left: IndexArray
    right: IndexArray
    runs: IndexArray
    targets: IndexArray


def _chunks(structure: Structure, blocks: IndexArray) -> list[_Chunk]:
    """The pairs of some blocks of the complement, cut at blocks."""
    lengths = np.diff(structure.runs)[blocks]
    cuts = np.searchsorted(np.cumsum(lengths), np.arange(_CHUNK, int(lengths.sum()) + _CHUNK, _CHUNK))
    out = []
    for some in np.split(blocks, np.unique(cuts)):
        if len(some):
            first, length = structure.runs[some], np.diff(structure.runs)[some]
            runs = np.concatenate([[0], np.cumsum(length)])
            pairs: slice | IndexArray = slice(int(first[0]), int(first[0] + runs[-1]))
            if some[-1] - some[0] >= len(some):  # with others between them
                pairs = np.arange(int(runs[-1])) + np.repeat(first - runs[:-1], length)
            out.append(_Chunk(structure.left[pairs], structure.right[pairs], runs, structure.targets[some]))
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
