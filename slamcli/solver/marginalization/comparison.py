"""What a reduced graph says beside the exact marginal of the full one: divergence, shift, standard deviations.

Both are linearized at the same values, and the same variables are held. With S the information of the reduced graph,
Lambda = Sigma^-1 that of the marginal, d the difference of their Gauss-Newton steps and n the dimension,

    KLD = (tr(S Sigma) - log det S + log det Lambda - n + d^T S d) / 2

is the divergence of the reduced graph's Gaussian from the marginal, in nats.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from cvxopt import lapack, matrix
from numpy.typing import NDArray

from slamcli.errors import NumericalError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import component_labels
from slamcli.models.base import Array, dot
from slamcli.solver import gauge, ordering
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.backends.cholmod import supernodal_factor
from slamcli.solver.covariance.rounding import regular_by_rounding
from slamcli.solver.covariance.selected_inverse import selected_inverse
from slamcli.solver.gauge import Held
from slamcli.solver.marginalization.reduction import Reduction
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.problem import Problem
from slamcli.solver.stopwatch import Stopwatch

#: Dimensions of the kept variables up to which divergence and standard deviations are compared: with dense matrices.
LARGEST = 4500
#: Standard deviations by which the optimum may move: beyond them the reduced graph is another one.
LARGEST_SHIFT = 3.0


@dataclass(frozen=True)
class Comparison:
    """The reduced graph beside the marginal of the full one.

    Attributes
    ----------
    divergence
        KLD in nats, that of the means included; None beyond ``LARGEST`` dimensions.
    dimension
        n, dimensions of the kept variables that are not held.
    shift
        Largest distance in metres between the kept positions after one Gauss-Newton step in both graphs.
    shift_sigmas
        Largest ratio of such a distance to the position's standard deviation in the full graph (square root of the
        trace of its covariance).
    sigma_ratio
        Smallest, median and largest ratio of the kept positions' standard deviations, reduced to full; above 1 the
        reduced graph is the less confident one. None beyond ``LARGEST`` dimensions.
    predicted_decrease
        Of the full graph's chi2 by a Gauss-Newton step, the squared distance to the optimum in standard deviations.
    """

    divergence: float | None
    dimension: int
    shift: float
    shift_sigmas: float
    sigma_ratio: tuple[float, float, float] | None
    predicted_decrease: float

    def at_optimum(self, chi2: float) -> bool:
        """Whether the values are within a tenth of a standard deviation of an optimum of the full graph."""
        return self.predicted_decrease <= max(0.01, 1e-6 * chi2)


def compare(graph: FactorGraph, reduction: Reduction) -> Comparison | None:
    """Compare a reduced graph with the full one; None where either is singular, or nothing is left to compare."""
    reduced = reduction.graph
    if not reduced.factors:
        return None
    own = gauge.choose(reduced)[1]
    if all(mask.all() for mask in own.values()):
        return None
    held = _same_gauge(graph, reduction, own)
    options = OptimizeOptions()
    full = Problem(graph, held, options, Stopwatch())
    there = full.linearize(graph.values)
    small = Problem(reduced, own, options, Stopwatch())
    here = small.linearize(reduced.values)
    index = _kept_rows(graph, reduction, held)
    dense: tuple[float | None, tuple[float, float, float] | None] = (None, None)
    try:
        step = full.solve(there)
        difference = small.solve(here) - step[index]
        inverse = selected_inverse(full.pattern, full.permutation, there.hessian)
        if regular_by_rounding(graph, held, full, there, inverse):
            return None
        if len(index) <= LARGEST:
            marginal = _marginal_factor(full, there.hessian, index)
            dense = _compare_dense(reduced, own, small.pattern, here.hessian, marginal, difference)
    except (NotPositiveDefiniteError, np.linalg.LinAlgError):
        return None
    moved = np.sqrt(_positions(reduced, own, np.square(difference)))
    sigmas = np.sqrt(_positions(reduced, own, inverse[full.pattern.diagonal][index]))
    return Comparison(
        divergence=dense[0],
        dimension=len(index),
        shift=float(moved.max(initial=0.0)),
        shift_sigmas=float((moved / sigmas).max(initial=0.0)),
        sigma_ratio=dense[1],
        predicted_decrease=max(0.0, -dot(there.gradient, step)),
    )


def require_same_optimum(graph: FactorGraph, comparison: Comparison | None) -> None:
    """Refuse a reduced graph that moves the optimum of the full one far beyond its uncertainty.

    Raises
    ------
    NumericalError
        If the values are an optimum, and a kept position moves by more than ``LARGEST_SHIFT`` standard deviations.
    """
    if comparison is None or not comparison.at_optimum(graph.chi2()) or comparison.shift_sigmas <= LARGEST_SHIFT:
        return
    raise NumericalError(
        f"the recovered edges would move kept positions by up to {comparison.shift:.3g} m, "
        f"{comparison.shift_sigmas:.3g} of their standard deviations: nothing is written",
        (
            "  they cannot hold the gradient of a marginal that says nothing of some directions",
            "  keep more of the variables, or another --sparsify",
        ),
    )


def _compare_dense(
    reduced: FactorGraph, own: Held, pattern: BlockPattern, hessian: Array, marginal: Array, difference: Array
) -> tuple[float, tuple[float, float, float]]:
    """KLD and ratios of the standard deviations, from the lower factor of the marginal.

    Raises
    ------
    LinAlgError
        If the reduced graph's H is not positive definite.
    """
    information = np.zeros((len(difference), len(difference)))
    information[pattern.scalar_rows, pattern.scalar_columns] = hessian
    information[pattern.scalar_columns, pattern.scalar_rows] = hessian
    factor = np.linalg.cholesky(information)
    inverses = _lower_inverse(factor), _lower_inverse(marginal)
    log_dets = 2.0 * float(np.log(np.diagonal(marginal)).sum() - np.log(np.diagonal(factor)).sum())
    trace = float(np.square(inverses[1] @ factor).sum()) - len(difference)
    moved = float(np.square(factor.T @ difference).sum())
    sigmas = [_position_variances(reduced, own, inverse) for inverse in inverses]
    ratio = np.sqrt(sigmas[0] / sigmas[1])
    return max(0.0, 0.5 * (trace + log_dets + moved)), (
        float(ratio.min()),
        float(np.median(ratio)),
        float(ratio.max()),
    )


def _same_gauge(graph: FactorGraph, reduction: Reduction, own: Held) -> Held:
    """What the reduced graph holds, in the full one; what was conditioned on; and what is not tied to anything kept."""
    held = {}
    label = component_labels(graph)
    gone = np.concatenate([reduction.removed[name] for name in graph.variables])
    alive = np.zeros(int(label.max(initial=-1)) + 1, dtype=bool)
    alive[label[~gone]] = True
    start = 0
    for name, column in graph.variables.items():
        mask = ~alive[label[start : start + len(column)]]
        mask |= np.isin(column.ids, np.array(reduction.conditioned, dtype=column.ids.dtype)) & reduction.removed[name]
        if name in own:
            mask[np.flatnonzero(~reduction.removed[name])[own[name]]] = True
        held[name] = mask
        start += len(column)
    return held


def _kept_rows(graph: FactorGraph, reduction: Reduction, held: Held) -> IndexArray:
    """Scalar rows of the full H of the kept free variables, in the order of the reduced graph's."""
    rows: dict[str, IndexArray] = {}
    start = 0
    for name, column in graph.variables.items():
        free: BoolArray = ~held[name]
        d = column.kind.dimension
        first = start + d * (np.cumsum(free) - 1)
        kept = np.flatnonzero(free & ~reduction.removed[name])
        rows[name] = (first[kept, None] + np.arange(d)).ravel()
        start += d * int(np.count_nonzero(free))
    return np.concatenate([rows[name] for name in reduction.graph.variables])


def _marginal_factor(problem: Problem, hessian: Array, index: IndexArray) -> Array:
    """Lower triangular (n, n) factor of the Schur complement onto some scalar rows: what is left when they go last.

    Eliminated last, their part of L is a factor of the Schur complement, in the order of elimination.
    """
    pattern = problem.pattern
    kept = np.zeros(pattern.dimension, dtype=bool)
    kept[index] = True
    blocks = ordering.order("amd", pattern)
    late = kept[pattern.offsets[blocks]]
    blocks = np.concatenate([blocks[~late], blocks[late]])
    order, starts, rows, entries = supernodal_factor(pattern, ordering.expand(pattern, blocks), hessian)
    columns = np.repeat(np.arange(len(order)), np.diff(starts))
    mine = kept[order]
    part = mine[columns] & mine[rows]
    position = np.cumsum(mine) - 1
    lower = np.zeros((len(index), len(index)))
    lower[position[rows[part]], position[columns[part]]] = entries[part]
    place = np.empty(pattern.dimension, dtype=np.intp)
    place[order[mine]] = np.arange(len(index))
    lower = lower[place[index]]  # a square root of the marginal in the order of ``index``
    return np.asarray(np.linalg.cholesky(lower @ lower.T), dtype=np.float64)


def _lower_inverse(lower: NDArray[np.floating[Any]]) -> Array:
    """Inverse of a lower triangular matrix."""
    out = matrix(lower)
    lapack.trtri(out)
    return np.tril(np.array(out))


def _position_variances(graph: FactorGraph, held: Held, inverse: Array) -> Array:
    """Trace of the covariance of each free variable's position, from the inverse of a lower factor."""
    return _positions(graph, held, np.square(inverse).sum(axis=0))


def _positions(graph: FactorGraph, held: Held, scalars: Array) -> Array:
    """Sum of a scalar row's number over the position of each free variable."""
    out, start = [], 0
    for name, column in graph.variables.items():
        count = int(np.count_nonzero(~held[name]))
        stop = start + count * column.kind.dimension
        out.append(scalars[start:stop].reshape(count, column.kind.dimension)[:, : column.kind.space].sum(axis=1))
        start = stop
    return np.concatenate(out)
