"""Linearize and assemble: from a graph and a state to H, gradient and chi2.

With e(x + J delta) to first order, chi2(x (+) delta) = chi2 + 2 g^T delta + delta^T H delta where

    H = sum J^T Omega J,    g = sum J^T Omega e

(no factor of one half anywhere, as in g2o). A Gauss-Newton step solves H delta = -g.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import IndexArray, Values
from slamcli.models.base import Array
from slamcli.solver import grouped_batches
from slamcli.solver import pattern as patterns
from slamcli.solver.freedoms import Frozen
from slamcli.solver.gauge import Held
from slamcli.solver.grouped_batches import GroupedBatch
from slamcli.solver.robust.loss import Loss, Losses
from slamcli.solver.stopwatch import Stopwatch

#: Numbers in one of a batch's arrays: a few of these together stay within a core's second-level cache.
_BATCH_NUMBERS = 120_000


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """H and gradient at one state.

    Attributes
    ----------
    values
        The state.
    chi2
        Sum of e^T Omega e there (of the losses, where there are any).
    hessian
        Stored values of the upper blocks of H, in the order of the pattern.
    gradient
        (dimension,) J^T Omega e.
    """

    values: Values
    chi2: float
    hessian: Array
    gradient: Array

    @property
    def gradient_norm(self) -> float:
        """Largest component of the gradient."""
        return float(np.abs(self.gradient).max(initial=0.0))

    @property
    def is_finite(self) -> bool:
        """Whether everything in it is finite: a NaN or infinity anywhere shows in these two sums."""
        return bool(np.isfinite(self.chi2 + self.gradient.sum() + self.hessian.sum()))


class Linearizer:
    """Linearizes one graph at any number of states; pattern and targets are built once.

    The factors are taken in batches whose arrays fit in the processor's cache together.

    Parameters
    ----------
    graph
        Its factors and kinds of variables; the values come with each call.
    held
        Which variables do not move.
    stopwatch
        Where the time goes.
    losses
        What the squared residuals count, for each column of factors; None for plain least squares.
    frozen
        Single tangent dimensions that do not move either.

    Attributes
    ----------
    frozen
        Their scalar rows of H, of which only the diagonal entries are left, so that steps are zero there.
    """

    def __init__(
        self,
        graph: FactorGraph,
        held: Held,
        stopwatch: Stopwatch,
        losses: Losses | None = None,
        frozen: Frozen | None = None,
    ) -> None:
        self.graph = graph
        self.losses: Losses = losses or [None] * len(graph.factors)
        self.stopwatch = stopwatch
        self.free = {name: np.flatnonzero(~held[name]) for name in graph.variables}
        grouped = [grouped_batches.suits(factors) for factors in graph.factors]
        self.pattern, targets = patterns.build(graph, held, grouped)
        self.frozen, self._silent = _silenced(graph, held, self.pattern, frozen or {})
        self._memory: list[Array] = []
        self._batches: list[_Batch | GroupedBatch] = []
        self._grouped: list[list[GroupedBatch]] = []
        for factors, target, loss in zip(graph.factors, targets, self.losses, strict=True):
            if isinstance(target, patterns.BlockTargets):
                joined = set(factors.kind.variables)
                alone = sum(joined <= set(other.kind.variables) for other in graph.factors) == 1
                self._grouped.append(grouped_batches.batches(factors, target, self.pattern, loss, alone))
                self._batches += self._grouped[-1]
            else:
                self._grouped.append([])
                self._batches += _batches(factors, target, loss)

    def linearize(self, values: Values) -> LinearSystem:
        """chi2, gradient and H at a state."""
        stored, dimension = self.pattern.stored, self.pattern.dimension
        total, chi2 = self._zeros(stored + dimension + 1), 0.0
        with np.errstate(all="ignore"):
            for batch in self._batches:
                with self.stopwatch.phase("linearize"):
                    chi2 += batch.linearize(values)
                with self.stopwatch.phase("assemble"):
                    batch.add_to(total)
        if len(self._silent):
            total[self._silent] = 0.0
        return LinearSystem(values, chi2, total[:stored], total[stored : stored + dimension])

    def _zeros(self, size: int) -> Array:
        """Zeros, in the memory of a system that nobody has any more: fresh memory costs as much as adding to it."""
        for k in range(len(self._memory)):
            if sys.getrefcount(self._memory[k]) <= 2:  # the list's and the argument's; arrays are views of it
                self._memory[k].fill(0.0)
                return self._memory[k]
        self._memory.append(np.zeros(size))
        return self._memory[-1]

    def chi2(self, values: Values) -> float:
        """chi2 at a state, without the derivatives."""
        with self.stopwatch.phase("linearize"):
            return math.fsum(
                sum(batch.chi2(values) for batch in batches)
                if batches
                else float(_cost(factors.chi2(values), loss).sum())
                for factors, loss, batches in zip(self.graph.factors, self.losses, self._grouped, strict=True)
            )

    def rounding(self, values: Values) -> float:
        """chi2 of residuals that are rounding alone: sum tr(Omega) (eps x)^2, x the largest value an edge depends on.

        Matters where all edges can be satisfied: chi2 then ends at rounding, and its changes are no share of it.
        """
        total = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            size = {name: np.abs(column).max(axis=1, initial=0.0) for name, column in values.items()}
            for factors in self.graph.factors:
                slots = enumerate(factors.kind.variables)
                largest = np.max([size[kind.name][factors.indices[:, slot]] for slot, kind in slots], axis=0)
                weight = np.abs(np.trace(factors.information, axis1=1, axis2=2))
                total += float((weight * np.square(np.finfo(np.float64).eps * largest)).sum())
        return total if np.isfinite(total) else 0.0

    def retract(self, values: Values, delta: Array) -> Values:
        """The state after a tangent step (dimension,) of the free variables."""
        out, start = dict(values), 0
        with self.stopwatch.phase("retract"):
            for name, rows in self.free.items():
                kind = self.graph.variables[name].kind
                stop = start + len(rows) * kind.dimension
                step = delta[start:stop].reshape(len(rows), kind.dimension)
                moved = values[name].copy()
                moved[rows] = kind.retract(values[name][rows], step)
                out[name] = moved
                start = stop
        return out


class _Batch:
    """Factors that are linearized together, with buffers for ``[J_1 ... J_n, e]`` and the products with it."""

    def __init__(
        self, factors: Factors, targets: list[IndexArray], workspace: _Workspace, loss: Loss | None, rows: slice
    ) -> None:
        self._factors = factors
        self._loss, self._rows = loss, rows
        self._targets = [slot.ravel() for slot in targets]
        m = len(factors)
        self._augmented, self._weighted = workspace.augmented[:m], workspace.weighted[:m]
        ends = np.cumsum([kind.dimension for kind in factors.kind.variables]).tolist()
        starts = [0, *ends[:-1]]
        self._jacobians = tuple(self._augmented[:, :, a:b] for a, b in zip(starts, ends, strict=True))
        self._products = [
            (jacobian.transpose(0, 2, 1), self._weighted[:, :, start:], product[: slot.size].reshape(slot.shape))
            for jacobian, start, slot, product in zip(self._jacobians, starts, targets, workspace.products, strict=True)
        ]

    def linearize(self, values: Values) -> float:
        """Fill the buffers at a state and return the chi2 (the cost, where there is a loss) of the batch."""
        factors = self._factors
        residual = self._augmented[:, :, -1]
        factors.kind.linearize_into(
            residual, self._jacobians, factors.gather(values), factors.measurements, factors.parameters
        )
        np.matmul(factors.information, self._augmented, out=self._weighted)
        cost = np.vecdot(residual, self._weighted[:, :, -1])
        if self._loss is not None:
            cost, weight = self._loss.evaluate(cost, self._rows)
            self._weighted *= weight[:, None, None]
        for transposed, weighted, product in self._products:
            np.matmul(transposed, weighted, out=product)
        return float(cost.sum())

    def add_to(self, total: Array) -> None:
        """Add the products to the stored values of H and the gradient."""
        for target, (_, _, product) in zip(self._targets, self._products, strict=True):
            np.add.at(total, target, product.ravel())


class _Workspace:
    """Buffers that all batches of one column of factors share."""

    def __init__(self, shape: tuple[int, int, int], targets: list[IndexArray]) -> None:
        self.augmented, self.weighted = np.zeros(shape), np.empty(shape)
        self.products = [np.empty(shape[0] * slot.shape[1] * slot.shape[2]) for slot in targets]


def _batches(factors: Factors, targets: list[IndexArray], loss: Loss | None) -> Iterator[_Batch]:
    """Cut a column of factors into batches."""
    width = 1 + sum(kind.dimension for kind in factors.kind.variables)
    size = min(len(factors), max(256, _BATCH_NUMBERS // (factors.kind.dimension * width)))
    workspace = _Workspace((size, factors.kind.dimension, width), targets)
    for start in range(0, len(factors), size):
        rows = slice(start, start + size)
        yield _Batch(factors.part(rows), [slot[rows] for slot in targets], workspace, loss, rows)


def _silenced(
    graph: FactorGraph, held: Held, pattern: patterns.BlockPattern, frozen: Frozen
) -> tuple[IndexArray, IndexArray]:
    """Scalar rows of frozen dimensions, and the positions of what they have in H and gradient but the diagonal."""
    parts = [
        frozen[name][~held[name]].ravel()
        if name in frozen
        else np.zeros(int((~held[name]).sum()) * column.kind.dimension, dtype=bool)
        for name, column in graph.variables.items()
    ]
    mask = np.concatenate(parts)
    rows = np.flatnonzero(mask)
    if len(rows) == 0:
        return rows, rows
    off = pattern.scalar_rows != pattern.scalar_columns
    entries = np.flatnonzero((mask[pattern.scalar_rows] | mask[pattern.scalar_columns]) & off)
    return rows, np.concatenate([entries, pattern.stored + rows])


def _cost(squared: Array, loss: Loss | None) -> Array:
    """What squared residuals (n,) of a whole column count."""
    return squared if loss is None else loss.evaluate(squared, slice(None))[0]
