"""One start and the iterations from it: the loop that every optimization consists of."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from slamcli.graph import FactorGraph
from slamcli.solver import diagnosis, policies
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.gauge import Held
from slamcli.solver.initialization import Start
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.policies.steps import Step
from slamcli.solver.problem import Problem
from slamcli.solver.result import IterationRecord, Status
from slamcli.solver.schur import NotSolvedError
from slamcli.solver.termination import Termination, Verdict

#: Called with the name of a start, its chi2 and no record, then with each iteration's record.
OnIteration = Callable[[str, float, IterationRecord | None], None]


class Attempt:
    """A run from one start.

    Parameters
    ----------
    problem
        May serve several runs, one after the other.
    start
        Where it begins.
    options
        Method, tolerance, budgets.
    on_iteration
        Watches it.
    began
        When the budget of seconds began to run, by ``time.perf_counter``.

    Attributes
    ----------
    start
        Where it began.
    initial
        chi2 there.
    now
        The state that it has come to, linearized.
    trace
        Its iterations.
    verdict
        How it ended, None while it may go on.
    """

    def __init__(
        self, problem: Problem, start: Start, options: OptimizeOptions, on_iteration: OnIteration, began: float
    ) -> None:
        self.problem = problem
        self.start = start
        self.trace: list[IterationRecord] = []
        self.verdict: Verdict | None = None
        self._on_iteration = on_iteration
        self._options = options
        self._policy = policies.make(options)
        self._diagnosis: Callable[[FactorGraph, Held], tuple[str, tuple[str, ...]]] | None = None
        self._began = began
        self.now: LinearSystem = problem.linearize(start.values)
        self.initial = self.now.chi2
        self._termination = Termination(options, self.initial, problem.rounding(start.values))
        on_iteration(start.name, self.initial, None)
        if not self.now.is_finite:
            self._fail(partial(_not_finite, system=self.now))
        elif self.now.gradient_norm == 0.0 and problem.full_step(self.now).singular:
            self._fail(self._singular)
        else:
            self.verdict = self._termination.at_start(self.now.gradient_norm)

    @property
    def chi2(self) -> float:
        """At the state that it has come to."""
        return self.now.chi2

    @property
    def lowest(self) -> float:
        """The lowest chi2 on the way; that of the state once the run has ended."""
        if self.verdict is not None:
            return self.chi2
        return min([self.initial, *(record.chi2 for record in self.trace)])

    @property
    def singular(self) -> bool:
        """Whether not even the first step exists: the edges do not determine all variables."""
        return self._diagnosis is not None and not self.trace and self.now.is_finite

    @property
    def failed(self) -> bool:
        """Whether it has ended in a numerical failure."""
        return self._diagnosis is not None

    @property
    def converged(self) -> bool:
        """Whether it has ended at a minimum."""
        return self.verdict is not None and self.verdict.status is Status.CONVERGED

    def advance(self) -> None:
        """One iteration."""
        began, iterations = time.perf_counter(), self.problem.linear_iterations
        try:
            step = self._policy.step(self.problem, self.now)
        except NotPositiveDefiniteError as error:
            found = partial(_not_solved, error=error) if isinstance(error, NotSolvedError) else self._singular
            return self._fail(found)
        if not step.system.is_finite:
            return self._fail(partial(_not_finite, system=step.system))
        decrease, self.now = self.now.chi2 - step.system.chi2, step.system
        now = time.perf_counter()
        if iterations is not None:
            iterations = (self.problem.linear_iterations or 0) - iterations
        self._record(step, decrease, now - began, iterations)
        full_step = partial(self.problem.full_step, self.now)
        self.verdict = self._termination.after(step, decrease, len(self.trace), now - self._began, full_step)
        return None

    def interrupt(self) -> None:
        """End here on request, unless it has ended."""
        self.verdict = self.verdict or Verdict(Status.INTERRUPTED, f"on request, after iteration {len(self.trace)}")

    def leave(self) -> None:
        """End here since another run came lower, unless it has ended."""
        self.verdict = self.verdict or Verdict(Status.NOT_CONVERGED, "left: another start came lower")

    def diagnose(self, graph: FactorGraph, held: Held) -> tuple[str, ...]:
        """Details of a numerical failure, one line each; completes the verdict's reason."""
        if self._diagnosis is None:
            return ()
        reason, details = self._diagnosis(graph, held)
        self.verdict = Verdict(Status.FAILED, reason)
        return details

    def _record(self, step: Step, decrease: float, seconds: float, linear_iterations: int | None) -> None:
        record = IterationRecord(
            iteration=len(self.trace) + 1,
            chi2=step.system.chi2,
            chi2_change=-decrease,
            gradient_norm=step.system.gradient_norm,
            step_norm=step.norm,
            damping=step.damping,
            gain_ratio=step.gain,
            trials=step.trials,
            accepted=step.accepted,
            step=step.kind,
            time=seconds,
            linear_iterations=linear_iterations,
        )
        self.trace.append(record)
        self._on_iteration(self.start.name, record.chi2, record)

    def _fail(self, found: Callable[[FactorGraph, Held], tuple[str, tuple[str, ...]]]) -> None:
        self._diagnosis = found
        self.verdict = Verdict(Status.FAILED, "numerical failure")

    def _singular(self, graph: FactorGraph, held: Held) -> tuple[str, tuple[str, ...]]:
        reason, details = diagnosis.not_positive_definite(graph, held, self.problem, self.now)
        if self.now.chi2 > self.initial:
            risen = f"chi2 had risen from {self.initial:.6g} to {self.now.chi2:.6g}: the run was diverging"
            details = (f"{risen} (try --method lm, or another --init)", *details)
        return reason, details


def _not_solved(graph: FactorGraph, held: Held, *, error: NotSolvedError) -> tuple[str, tuple[str, ...]]:
    hint = "H is singular or ill-conditioned: --method lm damps it, --reduced-solver sparse factorizes it"
    return str(error), (hint,)


def _not_finite(graph: FactorGraph, held: Held, *, system: LinearSystem) -> tuple[str, tuple[str, ...]]:
    return diagnosis.not_finite(graph, system)
