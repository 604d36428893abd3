"""Linearization of many factors of few variables: what a camera sees of its points.

Where a variable has hundreds of factors, their products add up in one matrix product, and where a residual has two or
three numbers, products of single factors are sums of two or three terms. So the factors are sorted by that variable
and linearized into arrays with one row for each entry of [J_c, e, J_p], as long as the batch: every product is then
arithmetic on long rows. On 80 000 observations of 16 cameras this takes a fifth of the time of one small matrix product
for each factor.
"""

from __future__ import annotations

import numpy as np

from slamcli.graph import Factors
from slamcli.graph.columns import IndexArray, Values
from slamcli.models.base import Array
from slamcli.solver.block_pieces import BlockPieces
from slamcli.solver.pattern import BlockPattern, BlockTargets
from slamcli.solver.robust.loss import Loss

#: Factors in a batch: its arrays stay within a core's second-level cache.
_BATCH = 8192
#: Factors for each variable of the grouping slot, on average, from which on this pays.
_PAYS = 32
#: Factors of one camera in a batch, on average, below which batches are cut another way.
_RUN = 64


def suits(factors: Factors) -> bool:
    """Whether a column of factors is of this sort: two kinds of variables, few of one, isotropic information."""
    kinds = factors.kind.variables
    if len(kinds) != 2 or kinds[0] is kinds[1] or len(factors) == 0:
        return False
    return len(factors) >= _PAYS * min(_joined(factors)) and _weights(factors) is not None


def _joined(factors: Factors) -> list[int]:
    """How many variables of each slot have a factor."""
    return [int(np.count_nonzero(np.bincount(factors.indices[:, slot]))) for slot in (0, 1)]


def _weights(factors: Factors) -> Array | None:
    """Weights w (m,) where all information matrices are w times the identity, else None."""
    weights = factors.information[:, 0, 0]
    if factors.information.strides[0] == 0:  # one matrix for all
        first = factors.information[0]
        return weights if np.array_equal(first, first[0, 0] * np.eye(factors.kind.dimension)) else None
    same = (factors.information == weights[:, None, None] * np.eye(factors.kind.dimension)).all()
    return weights if same and (weights >= 0.0).all() else None


def batches(
    factors: Factors, targets: BlockTargets, pattern: BlockPattern, loss: Loss | None, alone: bool = False
) -> list[GroupedBatch]:
    """Cut a column of factors into batches of neighbouring points, each sorted by its cameras.

    (Points and cameras stand for the variables of the two slots.) H has the blocks of a point together, so that a batch
    writes to one part of it. ``alone`` says that no other column joins variables of these two kinds.
    """
    entries = np.sort(targets.entries[2])
    exclusive = alone and not ((entries[1:] == entries[:-1]) & (entries[1:] >= 0)).any()
    one, two = _joined(factors)
    many = 0 if one <= two else 1
    cameras, points = factors.indices[:, many], factors.indices[:, 1 - many]
    views = np.bincount(points)
    batch = (np.cumsum(views)[points] - 1) // _BATCH
    if len(factors) < _RUN * len(np.unique(batch * len(factors) + cameras)):
        # too many cameras in a batch: points with the same first camera together instead of neighbours
        first = np.full(len(views), len(factors))
        np.minimum.at(first, points, cameras)
        by_camera = np.argsort(first, kind="stable")
        ends = np.empty(len(views), dtype=np.intp)
        ends[by_camera] = np.cumsum(views[by_camera])
        batch = (ends[points] - 1) // _BATCH
    order = np.lexsort((points, cameras, batch))
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(batch[order])) + 1, [len(factors)]])
    kinds = factors.kind.variables
    width = kinds[0].dimension + kinds[1].dimension + 1
    buffer = np.zeros((factors.kind.dimension, width, int(np.diff(cuts).max())))
    weights = _weights(factors)
    assert weights is not None
    root = None if (weights == 1.0).all() else np.sqrt(weights)
    return [
        GroupedBatch(factors, targets, pattern, loss, order[begin:end], many, root, buffer, exclusive)
        for begin, end in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True)
    ]


class GroupedBatch:
    """Some factors, sorted by the slot that has few variables ("c"; the other one is "p").

    Parameters
    ----------
    factors, targets
        The whole column, and where its blocks go.
    pattern
        Of H.
    loss
        What squared residuals count, or None.
    rows
        (m,) which factors.
    slot
        The slot by which they are sorted.
    root
        Roots of the weights of the whole column, None where all are 1.
    buffer
        (d, width, >= m) room that batches share.
    exclusive
        Whether no other factor joins the same two variables as one of these.
    """

    def __init__(
        self,
        factors: Factors,
        targets: BlockTargets,
        pattern: BlockPattern,
        loss: Loss | None,
        rows: IndexArray,
        slot: int,
        root: Array | None,
        buffer: Array,
        exclusive: bool,
    ) -> None:
        self._factors, self._loss, self._rows, self._slot = factors.part(rows), loss, rows, slot
        self._root = None if root is None else root[rows]
        c, p = (factors.kind.variables[k].dimension for k in (slot, 1 - slot))
        self._buffer = buffer[:, :, : len(rows)]
        by_factor = self._buffer.transpose(2, 0, 1)
        parts = by_factor[:, :, :c], by_factor[:, :, c + 1 :]
        self._residual, self._jacobians = by_factor[:, :, c], parts if slot == 0 else parts[::-1]
        self._c, self._p = c, p
        own, other = targets.blocks[slot][rows], targets.blocks[1 - slot][rows]
        starts = np.concatenate([[0], np.flatnonzero(np.diff(self._factors.indices[:, slot])) + 1, [len(rows)]])
        self._runs = [
            (begin, end, _block(pattern, int(own[begin]), c))
            for begin, end in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)
            if own[begin] >= 0
        ]
        upright = targets.flipped[rows] == (slot == 1)  # whether the stored block has c's rows
        self._both = BlockPieces(pattern, targets.entries[2][rows], (p, c), upright)
        self._exclusive = exclusive
        blocks, self._local = np.unique(other, return_inverse=True)
        held = int(blocks[0] < 0)
        blocks, self._held = blocks[held:], held
        self._points = np.empty((p, p + 1, len(blocks)), dtype=np.intp)
        inside = np.arange(p)
        for a in range(p):
            self._points[a, :p] = pattern.diagonal_base[blocks] + a + inside[:, None] * pattern.heights[blocks]
            self._points[a, p] = pattern.stored + pattern.offsets[blocks] + a

    def chi2(self, values: Values) -> float:
        """chi2 (the cost, where there is a loss) of the batch at a state."""
        factors = self._factors
        residual = factors.kind.residual(factors.gather(values), factors.measurements, factors.parameters)
        if self._root is not None:
            residual *= self._root[:, None]
        cost = np.square(residual).sum(axis=1)
        if self._loss is not None:
            cost = self._loss.evaluate(cost, self._rows)[0]
        return float(cost.sum())

    def linearize(self, values: Values) -> float:
        """Fill the buffer at a state and return the chi2 (the cost, where there is a loss) of the batch."""
        factors = self._factors
        factors.kind.linearize_into(
            self._residual, self._jacobians, factors.gather(values), factors.measurements, factors.parameters
        )
        if self._root is not None:
            self._buffer *= self._root
        cost = np.square(self._buffer[:, self._c]).sum(axis=0)
        if self._loss is not None:
            cost, weight = self._loss.evaluate(cost, self._rows)
            self._buffer *= np.sqrt(weight)
        return float(cost.sum())

    def add_to(self, total: Array) -> None:
        """Add the products to the stored values of H and the gradient."""
        c, p = self._c, self._p
        for begin, end, target in self._runs:
            run = self._buffer[:, : c + 1, begin:end]
            total[target] += sum(row[:c] @ row.T for row in run)
        of_c, of_p = self._buffer[:, :c], self._buffer[:, c + 1 :]
        product = np.empty((p, c, len(self._rows)))
        for a in range(c):
            for b in range(p):
                _dot(of_c[:, a], of_p[:, b], product[b, a])
        (self._both.write if self._exclusive else self._both.add)(total, product)
        row = product[0, 0]
        for a in range(p):
            for b in range(a, p + 1):
                _dot(of_p[:, a], of_p[:, b] if b < p else self._buffer[:, c], row)
                sums = np.bincount(self._local, row)[self._held :]
                total[self._points[a, b]] += sums
                if a < b < p:
                    total[self._points[b, a]] += sums


def _dot(one: Array, other: Array, out: Array) -> None:
    """Sum of the products of the rows of two (d, m) arrays."""
    np.multiply(one[0], other[0], out=out)
    for k in range(1, len(one)):
        out += one[k] * other[k]


def _block(pattern: BlockPattern, block: int, size: int) -> IndexArray:
    """Positions (size, size + 1) of a diagonal block of H, and of its part of the gradient."""
    height = int(pattern.heights[block])
    first = int(pattern.diagonal_base[block])
    inside = first + np.arange(size)[:, None] + height * np.arange(size)
    return np.concatenate([inside, pattern.stored + pattern.offsets[block] + np.arange(size)[:, None]], axis=1)
