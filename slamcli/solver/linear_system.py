"""Linearize and assemble: from a graph and a state to H, gradient and chi2.

With e(x + J delta) to first order, chi2(x (+) delta) = chi2 + 2 g^T delta + delta^T H delta where

    H = sum J^T Omega J,    g = sum J^T Omega e

(no factor of one half anywhere, as in g2o). A Gauss-Newton step solves H delta = -g.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray, Values
from slamcli.models.base import Array
from slamcli.solver import pattern as patterns
from slamcli.solver.gauge import Held
from slamcli.solver.stopwatch import Stopwatch


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """H and gradient at one state.

    Attributes
    ----------
    values
        The state.
    chi2
        Sum of e^T Omega e there.
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
    """Linearizes one graph at any number of states; pattern and scatter are built once.

    Parameters
    ----------
    graph
        Its factors and kinds of variables; the values come with each call.
    held
        Which variables do not move.
    stopwatch
        Where the time goes.
    """

    def __init__(self, graph: FactorGraph, held: Held, stopwatch: Stopwatch) -> None:
        self.graph = graph
        self.stopwatch = stopwatch
        self.free = {name: np.flatnonzero(~held[name]) for name in graph.variables}
        self.pattern, self._scatter = patterns.build(graph, held)
        self._hessian_parts = np.empty(len(self._scatter.hessian))
        self._gradient_parts = np.empty(len(self._scatter.gradient))

    def linearize(self, values: Values) -> LinearSystem:
        """chi2, gradient and H at a state."""
        chi2, h, g = 0.0, 0, 0
        with self.stopwatch.phase("linearize"), np.errstate(all="ignore"):
            for factors in self.graph.factors:
                residual, jacobians = factors.linearize(values)
                weighted = np.matvec(factors.information, residual)
                chi2 += float(np.vecdot(residual, weighted).sum())
                products = [factors.information @ jacobian for jacobian in jacobians]
                transposed = [jacobian.transpose(0, 2, 1) for jacobian in jacobians]
                for s, left in enumerate(transposed):
                    for right in products[s:]:
                        h = self._multiply(self._hessian_parts, h, left, right)
                for left in transposed:
                    g = self._multiply(self._gradient_parts, g, left, weighted[:, :, None])
        with self.stopwatch.phase("assemble"):
            stored, dimension = self.pattern.stored, self.pattern.dimension
            hessian = _summed(self._scatter.hessian, self._hessian_parts, stored)
            gradient = _summed(self._scatter.gradient, self._gradient_parts, dimension)
        return LinearSystem(values, chi2, hessian, gradient)

    @staticmethod
    def _multiply(buffer: Array, start: int, left: Array, right: Array) -> int:
        """Batched product into the next part of a buffer; returns where the part ends."""
        shape = (len(left), left.shape[1], right.shape[2])
        stop = start + math.prod(shape)
        np.matmul(left, right, out=buffer[start:stop].reshape(shape))
        return stop

    def chi2(self, values: Values) -> float:
        """chi2 at a state, without the derivatives."""
        with self.stopwatch.phase("linearize"), np.errstate(all="ignore"):
            return self.graph.chi2(values)

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


def _summed(targets: IndexArray, parts: Array, count: int) -> Array:
    """Parts added up by target; the targets behind the last one are held variables and fall away."""
    return np.asarray(np.bincount(targets, parts, count + 1)[:count], dtype=np.float64)
