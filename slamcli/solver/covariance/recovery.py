"""Covariances of a graph's variables at its values: blocks of H^-1, in the tangent space of ``VariableKind.retract``.

Marginals and the blocks of connected pairs come from one selected inversion; blocks of other pairs from solving for
the columns of the variables that were asked for. What is held has no error: its blocks are zero.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from slamcli.errors import InputError, NumericalError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver import bundle, diagnosis, gauge, scene_checks
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.covariance.rounding import regular_by_rounding
from slamcli.solver.covariance.selected_inverse import selected_inverse
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.problem import Problem
from slamcli.solver.result import Result
from slamcli.solver.stopwatch import Stopwatch

if TYPE_CHECKING:
    from slamcli.solver.under_observed import UnderObserved

#: A variable: the name of its kind, and its row in that column.
Member = tuple[str, int]


class CovarianceRecovery:
    """Covariances of one graph at its values.

    Parameters
    ----------
    graph
        The graph; its values are where it is linearized.
    options
        Elimination order, linear solver and what is held on top of what the graph holds.
    problem
        The linear problem of a run on the same graph, to use its pattern and order again; None to make one, as where
        that run iterated instead of factorizing.

    Attributes
    ----------
    under_observed, edges_left_out
        Landmarks that are not in the graph, since their edges do not determine them, and number of these (see
        ``recovery_at``).

    Raises
    ------
    InputError
        If the graph has no factors, or a variable no estimate.
    NumericalError
        If information matrices are indefinite, or chi2 or its derivatives are not finite.
    """

    def __init__(
        self,
        graph: FactorGraph,
        options: OptimizeOptions | None = None,
        problem: Problem | None = None,
    ) -> None:
        self.options = options or OptimizeOptions()
        self.under_observed: tuple[UnderObserved, ...] = ()
        self.edges_left_out = 0
        self.graph = bundle.with_intrinsics(graph, self.options.intrinsics).with_fixed(self.options.fix)
        _check(self.graph)
        scene_checks.require_finite(self.graph)
        scene_checks.check(self.graph)
        cameras = bundle.has_projections(self.graph)  # whose gauge must not be left free here
        self.gauge, self.held = gauge.choose(self.graph, "first" if cameras else "auto")
        self.chi2 = self.graph.chi2()
        self.dof = self.gauge.degrees_of_freedom(self.graph, self.held)
        self.problem = None if cameras or problem is None or problem.iterative else problem
        if self.problem is None and not all(mask.all() for mask in self.held.values()):
            self.problem = Problem(
                self.graph, self.held, self.options, Stopwatch(), factorized=True, frozen=self.gauge.frozen
            )

    @cached_property
    def _system(self) -> LinearSystem:
        assert self.problem is not None
        system = self.problem.linearize(self.graph.values)
        if not system.is_finite:
            raise NumericalError(*diagnosis.not_finite(self.graph, system))
        return system

    @cached_property
    def predicted_decrease(self) -> float:
        """How much chi2 falls at the end of a Gauss-Newton step: zero at an optimum.

        It is the squared Mahalanobis length of that step, g^T H^-1 g.

        Raises
        ------
        NumericalError
            If H is singular.
        """
        if self.problem is None:
            return 0.0
        step = self.problem.full_step(self._system)
        if step.singular:
            raise self._singular()
        return max(0.0, step.decrease)

    @cached_property
    def _inverse(self) -> Array:
        """Values of H^-1 on the pattern of H."""
        problem = self.problem
        assert problem is not None
        pattern, root = problem.pattern, self._scale
        scale = root[pattern.scalar_rows] * root[pattern.scalar_columns]
        try:
            out = scale * selected_inverse(pattern, problem.permutation, scale * self._system.hessian)
        except NotPositiveDefiniteError:
            raise self._singular() from None
        out[pattern.diagonal[problem.frozen]] = 0.0
        if regular_by_rounding(self.graph, self.held, problem, self._system, out):
            raise self._singular()
        return out

    @cached_property
    def _scale(self) -> Array:
        """What rows and columns of H are multiplied with before it is factorized: for cameras, to a diagonal of 1.

        Their tangent dimensions have units as different as radians, pixels and the distortion's 1, and pivots of
        points far away are as small beside those as rounding.
        """
        assert self.problem is not None
        diagonal = self.problem.diagonal(self._system)
        if not bundle.has_projections(self.graph):
            return np.ones_like(diagonal)
        return np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 1.0)

    def marginals(self) -> dict[str, Array]:
        """Marginal covariances (n, d, d) of all variables, by the name of their kind.

        Raises
        ------
        NumericalError
            If H is singular or indefinite; its details say which variables the edges do not determine.
        """
        out = {}
        for name, column in self.graph.variables.items():
            size = column.kind.dimension
            out[name] = np.zeros((len(column), size, size))
            free = np.flatnonzero(~self.held[name])
            if len(free):
                number = self._numbers[name][free]
                out[name][free] = self._blocks(number, number, size, size)
        return out

    def cross(self, kinds: tuple[str, str], rows: IndexArray) -> Array:
        """Cross-covariances (m, d, k) of connected pairs: kinds of the first and second, and (m, 2) their rows.

        Raises
        ------
        NumericalError
            If H is singular or indefinite.
        """
        columns = [self.graph.variables[name] for name in kinds]
        out = np.zeros((len(rows), *(column.kind.dimension for column in columns)))
        numbers = [self._numbers[name][rows[:, slot]] for slot, name in enumerate(kinds)]
        free = np.flatnonzero((numbers[0] >= 0) & (numbers[1] >= 0))
        if len(free):
            out[free] = self._blocks(numbers[0][free], numbers[1][free], *out.shape[1:])
        return out

    def joint(self, members: list[Member]) -> Array:
        """Joint covariance (D, D) of some variables, in their order, whether they are connected or not.

        Raises
        ------
        NumericalError
            If H is singular or indefinite.
        """
        sizes = [self.graph.variables[name].kind.dimension for name, _ in members]
        out = np.zeros((sum(sizes), sum(sizes)))
        place = np.full(len(out), -1, dtype=np.intp)
        for stop, size, (name, row) in zip(np.cumsum(sizes), sizes, members, strict=True):
            number = self._numbers[name][row]
            if number >= 0:
                assert self.problem is not None
                place[stop - size : stop] = self.problem.pattern.offsets[number] + np.arange(size)
        silent = np.empty(0, dtype=np.intp) if self.problem is None else self.problem.frozen
        free = np.flatnonzero((place >= 0) & ~np.isin(place, silent))
        for column, solution in zip(free, self._columns(place[free]), strict=True):
            out[free, column] = solution[place[free]]
        return 0.5 * (out + out.T)

    def _columns(self, scalars: IndexArray) -> list[Array]:
        """Columns of H^-1, factorizing once."""
        out: list[Array] = []
        if len(scalars) == 0:
            return out
        problem = self.problem
        assert problem is not None
        unit = np.zeros(problem.pattern.dimension)
        for scalar in scalars.tolist():
            unit[scalar] = -1.0
            probe = replace(self._system, gradient=unit)
            try:
                out.append(problem.solve_again(probe) if out else problem.solve(probe))
            except NotPositiveDefiniteError:
                raise self._singular() from None
            unit[scalar] = 0.0
        return out

    @cached_property
    def _numbers(self) -> dict[str, IndexArray]:
        """Number of each variable's block in H, -1 for what is held."""
        out, before = {}, 0
        for name, held in self.held.items():
            out[name] = np.where(held, -1, before + np.cumsum(~held) - 1)
            before += int(np.count_nonzero(~held))
        return out

    def _blocks(self, first: IndexArray, second: IndexArray, height: int, width: int) -> Array:
        """Blocks (m, height, width) of H^-1 by their block rows and columns, which are on the pattern of H."""
        assert self.problem is not None
        pattern = self.problem.pattern
        count = len(pattern.sizes)
        low, high = np.minimum(first, second), np.maximum(first, second)
        entry = np.searchsorted(pattern.columns * count + pattern.rows, high * count + low)
        base, stride = pattern.base[entry][:, None, None], pattern.heights[high][:, None, None]
        down, right = np.arange(height)[:, None], np.arange(width)
        flipped = (first > second)[:, None, None]  # stored as the transposed block
        return self._inverse[base + np.where(flipped, down * stride + right, down + right * stride)]

    def _singular(self) -> NumericalError:
        assert self.problem is not None
        reason, details = diagnosis.not_positive_definite(self.graph, self.held, self.problem, self._system)
        return NumericalError(f"no covariances: {reason}", details)


def recovery_at(graph: FactorGraph, options: OptimizeOptions | None = None) -> CovarianceRecovery:
    """Covariances of a graph at its values, without landmarks that its edges do not determine there.

    Raises
    ------
    InputError, NumericalError
        As ``CovarianceRecovery``.
    """
    options = options or OptimizeOptions()
    graph = bundle.with_intrinsics(graph, options.intrinsics).with_fixed(options.fix)
    poses = [column for column in graph.variables.values() if column.kind.is_pose]
    if graph.landmarks == 0 or not all(column.known.all() for column in poses):
        return CovarianceRecovery(graph, options)
    from slamcli.solver import under_observed  # most graphs do without

    lost = under_observed.at_values(graph)
    held_back = under_observed.HeldBack.of(graph, lost)
    reduced = held_back.reduced()
    if not lost or not reduced.factors or diagnosis.indefinite_information(graph) is not None:
        return CovarianceRecovery(graph, options)
    recovery = CovarianceRecovery(reduced, replace(options, fix=()))
    recovery.under_observed, recovery.edges_left_out = under_observed.described(graph, lost), held_back.edges
    return recovery


def recovery_of(result: Result) -> CovarianceRecovery:
    """Covariances at the end of a run that minimized chi2, with its linear problem.

    Where closures were rejected or a robust kernel took part, each factor has the weight that it had at the end: its
    information is multiplied by it, and what was rejected is not there. Nor are landmarks that were held back.
    """
    if result.rejection is None:
        recovery = CovarianceRecovery(result.optimized, result.options, result.problem)
    else:
        recovery = CovarianceRecovery(_weighted(result), result.options)
    if result.held_back is not None:
        recovery.under_observed, recovery.edges_left_out = result.under_observed, result.held_back.edges
    return recovery


def _weighted(result: Result) -> FactorGraph:
    """The graph without rejected and held-back factors, those that are left with the weight that they had."""
    assert result.rejection is not None
    factors = []
    for column, weight in zip(result.graph.factors, result.rejection.weight, strict=True):
        kept = np.flatnonzero(weight > 0.0)
        part = column.part(kept)
        factors.append(replace(part, information=weight[kept, None, None] * part.information))
    graph = replace(result.graph, factors=[part for part in factors if len(part)])
    return graph if result.held_back is None else result.held_back.without(graph)


def _check(graph: FactorGraph) -> None:
    """Refuse what has no covariances at all."""
    if not graph.factors:
        raise InputError("the graph has no edge that slamcli can use: nothing determines any variable")
    for column in graph.variables.values():
        unknown = np.flatnonzero(~column.known)
        if len(unknown):
            what = "1 variable has" if len(unknown) == 1 else f"{len(unknown)} variables have"
            raise InputError(
                f"{what} no estimate, the first {column.kind.name} {column.ids[unknown[0]]}",
                ("  covariances are those at the values of the file: slamcli optimize makes them",),
            )
    indefinite = diagnosis.indefinite_information(graph)
    if indefinite is not None:
        raise NumericalError(*indefinite)
