"""Certifies the global optimum of the isotropic chordal objective, and looks for it where the estimate is not."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slamcli.errors import NumericalError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import Values
from slamcli.graph.topology import component_labels
from slamcli.models.base import Array
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.certificate import connection as connections
from slamcli.solver.certificate import isotropic, staircase
from slamcli.solver.certificate.certificate import RESTARTS, Certificate, CertificateStatus, Escape, is_robust
from slamcli.solver.certificate.connection import Connection
from slamcli.solver.certificate.dual import CertificateMatrix, Eigenpair, Multipliers, smallest_eigenpair
from slamcli.solver.optimize import optimize
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.problem import Problem
from slamcli.solver.result import Result
from slamcli.solver.stopwatch import Stopwatch

#: The bound aimed at, as a share of the cost, and the range of eta over the scale of S in which it is sought.
_WANTED, _LEAST, _FIRST = 1e-6, 1e-13, 1e-8
#: Eta may rise to this share of the scale (but for rounding, not so far that the bound is more than this share of the
#: cost, which is also what a certificate needs).
_MOST, _LOOSEST = 1e-6, 1e-2
#: A cost is next to nothing where it is below this over the sum of 1 / kappa over all edges.
_NOTHING = 1e-6
#: Shifts over the scale of S at which the smallest eigenvalue is sought where the certificate fails.
_SHIFTS = tuple(10.0**k for k in range(-6, 4))
#: Extra Gauss-Newton steps at most, and the share of the cost by which cost and dual value may differ after them.
_EXTRA_STEPS, _DUAL_GAP = 20, 1e-9
#: A step that does not bring the gradient below this share of what it was shows that rounding is reached.
_PROGRESS = 0.7
#: Rows that the staircase adds at most.
_ROWS = 8
#: How the certified solution was found.
_DIRECT = "the critical point next to the estimate is the global minimum"
_WAYS = {
    "chordal": "the global minimum was found from the chordal relaxation, not next to the estimate",
    "staircase": "the global minimum was found by the Riemannian staircase, not next to the estimate",
}
#: Costs that differ by less than this share are those of one critical point.
_SAME = 1e-9
#: How many poses of a negative direction are named.
_MOVERS = 3


def inapplicable(graph: FactorGraph, options: OptimizeOptions) -> str | None:
    """Why a graph's optimum cannot be certified, or None where it can."""
    reason = isotropic.undefined(graph)
    if reason is not None:
        return f"the isotropic chordal objective is not defined: {reason}"
    if is_robust(options):
        return "the theory is one of least squares over all edges, and the run is a robust one"
    fixed = np.concatenate([column.fixed for column in graph.variables.values() if column.kind.is_pose])
    if (np.bincount(component_labels(graph)[fixed]) > 1).any():
        return "several poses of a component are fixed, and the theory leaves all but one free"
    return None


def certify(
    graph: FactorGraph,
    *,
    options: OptimizeOptions | None = None,
    minimized: Result | None = None,
    restarts: Sequence[str] = RESTARTS,
    interrupted: Callable[[], bool] = lambda: False,
) -> Certificate:
    """Certify the global minimum of the isotropic chordal objective, from the estimates of a graph.

    The estimate is polished to a critical point of the objective. If its certificate matrix has a negative eigenvalue,
    the chordal relaxation of the objective is tried as a start; if that fails, too, the Riemannian staircase leaves
    the lower one of both points and descends to another, which is rounded, polished and tested.

    Parameters
    ----------
    graph
        As it was read, at the estimate.
    options
        Of the runs that polish; robust ones make the certificate inapplicable. The time limit counts for each of those
        runs, and once more for the search after the first certificate.
    minimized
        A run that has minimized this objective already, so that its linear problem serves again: what ``optimize``
        returned for ``isotropic.transform`` of the graph.
    restarts
        What is tried where the first certificate fails, some of ``RESTARTS``.
    interrupted
        Asked before each step of the staircase whether to stop there.
    """
    options = options or OptimizeOptions()
    reason = inapplicable(graph, options)
    if reason is not None:
        return Certificate(CertificateStatus.INAPPLICABLE, reason)
    return _Certification(graph, options, minimized, interrupted).certificate(restarts)


@dataclass(frozen=True, eq=False)
class _Test:
    """A critical point under test: the eta with which it passes, or the eigenpair that fails it."""

    x: Array
    cost: float
    multipliers: Multipliers
    eta: float | None = None
    negative: Eigenpair | None = None


class _Certification:
    """State of one certification."""

    def __init__(
        self, graph: FactorGraph, options: OptimizeOptions, minimized: Result | None, interrupted: Callable[[], bool]
    ) -> None:
        self.options = replace(options, fix=())
        self.stopped = interrupted
        self.deadline = time.perf_counter() + (np.inf if options.time_limit is None else options.time_limit)
        self.stopwatch = Stopwatch()
        self.graph = isotropic.transform(graph)
        self.problem: Problem | None = None if minimized is None else minimized.problem
        #: Whether the problem has a factor of H that was left by a run.
        self.factorized = minimized is not None and bool(minimized.trace)
        with self.stopwatch.phase("assemble"):
            self.connection = Connection(self.graph)
            self.matrix = CertificateMatrix(self.connection)
        self.size = self.connection.count * self.connection.space
        self.escapes: list[Escape] = []
        self.way = _DIRECT
        #: Minimum of the relaxation, if the staircase found it.
        self.relaxed: float | None = None
        self.lower_bound = 0.0

    def interrupted(self) -> bool:
        """Whether to stop the search: on request, or because the time limit is used up."""
        return self.stopped() or time.perf_counter() > self.deadline

    def certificate(self, restarts: Sequence[str]) -> Certificate:
        """Polish, test, and look elsewhere where the test fails."""
        values = self.graph.values if self.problem is not None else self._minimized(self.graph.values)
        values = self._refined(values)
        test = self._tested(connections.state(self.connection, values))
        polished = test.cost
        for restart in restarts:
            if test.negative is None or self.interrupted():
                break
            found = self._minimized(self.graph.values, "chordal") if restart == "chordal" else self._climbed(test)
            found = self._refined(found)
            if self.graph.chi2(found) < (1.0 - _SAME) * test.cost:
                values, self.way = found, _WAYS[restart]
                test = self._tested(connections.state(self.connection, values))
        return self._statement(test, values, polished)

    def _minimized(self, values: Values, init: str = "file") -> Values:
        """Where a run ends."""
        with self.stopwatch.phase("polish"):
            options = replace(self.options, init=init)
            result = optimize(self.graph.with_values(values), options=options, interrupted=self.interrupted)
            self.problem, self.factorized = result.problem, bool(result.trace)
            return result.graph.values

    def _refined(self, values: Values) -> Values:
        """Gauss-Newton steps until the cost equals the dual value, or the gradient does not fall any more.

        So near the end H hardly changes: the factor that the run left serves as long as it makes progress.
        """
        if self.problem is None:  # nothing moves
            return values
        with self.stopwatch.phase("polish"):
            now, own = self.problem.linearize(values), False
            for _ in range(_EXTRA_STEPS):
                x = connections.state(self.connection, now.values)
                gap = now.chi2 - self.connection.constant - Multipliers.of(self.connection, x).trace
                if abs(gap) <= _DUAL_GAP * now.chi2:
                    break
                try:
                    step = self.problem.solve_again(now) if self.factorized else self.problem.solve(now)
                except NotPositiveDefiniteError:
                    break
                own, self.factorized = own or not self.factorized, True
                after = self.problem.linearize(self.problem.retract(now.values, step))
                if after.gradient_norm < _PROGRESS * now.gradient_norm:
                    now = after
                elif own:
                    break
                else:
                    self.factorized = False
            return now.values

    def _tested(self, x: Array) -> _Test:
        """Whether S of a point is positive semidefinite; what fails goes to the escapes."""
        cost, scale = self.connection.cost(x) + self.connection.constant, self.matrix.scale
        test = _Test(x, cost, Multipliers.of(self.connection, x))
        share = cost / (self.size * scale)
        eta = min(max(_WANTED * share, _LEAST), _FIRST)
        most = max(min(_MOST, _LOOSEST * share), 10.0 * _LEAST)
        with self.stopwatch.phase("factorize"):
            while eta <= most:
                if self._bounded(test.multipliers, eta * scale):
                    return replace(test, eta=eta * scale)
                eta *= 10.0
            if not any(self._bounded(test.multipliers, shift * scale) for shift in _SHIFTS):
                raise NumericalError("the certificate matrix cannot be factorized with any shift")
        with self.stopwatch.phase("eigenvalue"):
            found = smallest_eigenpair(self.matrix)
            self._bounded(test.multipliers, 1.001 * (abs(found.value) + found.error))
        self.escapes.append(Escape(x.shape[1], cost, found.value, found.error, self._movers(found)))
        return replace(test, negative=found)

    def _bounded(self, multipliers: Multipliers, shift: float) -> bool:
        """Whether the shift makes S positive definite; then the dual value bounds the minimum from below."""
        if not self.matrix.factorize(multipliers.blocks, shift):
            return False
        dual = self.connection.constant + multipliers.trace
        self.lower_bound = max(self.lower_bound, dual - shift * self.size)
        return True

    def _movers(self, pair: Eigenpair) -> tuple[tuple[int, float], ...]:
        share = np.square(pair.vector[:, : self.connection.space]).sum(axis=1)
        ids = self.graph.variables[self.connection.kind.name].ids
        return tuple((int(ids[k]), float(share[k])) for k in np.argsort(-share, kind="stable")[:_MOVERS])

    def _climbed(self, test: _Test) -> Values:
        """Where a run ends that starts from the minimum of the relaxation, rounded to poses."""
        anchor = test.x
        for _ in range(_ROWS):
            if test.negative is None or self.interrupted():
                break
            with self.stopwatch.phase("staircase"):
                x = staircase.climb(self.matrix, test.x, test.negative, self.interrupted).x
            test = self._tested(x)
        if test.negative is None and not self.interrupted():
            self.relaxed = test.cost
        rounded = staircase.rounded(self.matrix, test.x, anchor)
        poses = connections.poses(self.connection.kind, rounded)
        return self._minimized({**self.graph.values, self.connection.kind.name: poses})

    def _statement(self, test: _Test, values: Values, polished: float) -> Certificate:
        """The certificate of a point."""
        following = None
        with self.stopwatch.phase("eigenvalue"):
            if test.negative is not None:
                smallest = test.negative.value
            else:
                smallest = smallest_eigenpair(self.matrix).value
                others = self.size - self.connection.space * len(self.connection.pins)
                if others > 0:
                    following = smallest_eigenpair(self.matrix, test.x[:, :, : self.connection.space]).value
        graph = self.graph.with_values(values)
        return Certificate(
            status=CertificateStatus.CERTIFIED if self._decided(test) else CertificateStatus.NOT_CERTIFIED,
            reason=self._reason(test),
            graph=graph,
            cost=test.cost,
            estimate_cost=self.graph.chi2(),
            polished_cost=polished,
            dual_value=self.connection.constant + test.multipliers.trace,
            eta=np.nan if test.eta is None else test.eta,
            scale=self.matrix.scale,
            smallest_eigenvalue=smallest,
            next_eigenvalue=following,
            lower_bound=self.lower_bound,
            gradient_norm=float(np.abs(test.multipliers.residual).max(initial=0.0)),
            escapes=tuple(self.escapes),
            time=self.stopwatch.seconds,
        )

    def _decided(self, test: _Test) -> bool:
        """Whether the bound says something: it is a small share of the cost, or the cost itself is next to nothing.

        Rotations that are wound up by a turn along a loop cost at least 8 pi^2 over the sum of 1 / kappa.
        """
        with np.errstate(divide="ignore"):
            nothing = _NOTHING / float((1.0 / self.connection.weights[:, 0, 0]).sum() or 1.0)
        tight = test.cost - self.lower_bound <= _LOOSEST * test.cost or test.cost <= nothing
        return test.eta is not None and tight

    def _reason(self, test: _Test) -> str:
        if self._decided(test):
            return self.way
        if test.eta is not None:
            return "S has no negative eigenvalue, but beside its large entries rounding leaves the bound too loose"
        if self.relaxed is not None:
            return (
                f"no poses were found that reach the minimum {self.relaxed:.6f} of the relaxation; it may not be tight"
            )
        stopped = ", and the search for a lower point was stopped" if self.interrupted() else ""
        return f"the certificate matrix has a negative eigenvalue{stopped}"
