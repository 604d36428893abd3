"""Optimizes a graph: gauge, start, setup, then one policy's steps until the termination test is met."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from slamcli.errors import InputError, NumericalError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import Values
from slamcli.solver import diagnosis, gauge, policies
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.initialization import initialize
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.policies.steps import Step
from slamcli.solver.problem import Problem
from slamcli.solver.result import IterationRecord, Result, Status
from slamcli.solver.stopwatch import Stopwatch
from slamcli.solver.termination import Termination, Verdict

#: ``Result.start`` of a run that found no values to start from; its chi2 is NaN.
NO_START = "no start"

#: Called with the chi2 at the start and no record, then with each iteration's record.
OnIteration = Callable[[float, IterationRecord | None], None]


def optimize(
    graph: FactorGraph,
    *,
    options: OptimizeOptions | None = None,
    on_iteration: OnIteration | None = None,
    interrupted: Callable[[], bool] = lambda: False,
    **keywords: Any,
) -> Result:
    """Minimize chi2 over the variables of a graph.

    Parameters
    ----------
    graph
        The graph; it is not changed.
    options
        All options, or None to give them as keywords: ``method="lm", init="odometry", ...``.
    on_iteration
        Watches the run.
    interrupted
        Asked after each iteration whether to stop.

    Returns
    -------
    Result
        ``result.graph`` is a copy at the final values; ``result.status`` says how the run ended.

    Raises
    ------
    UsageError
        If an option does not exist.
    InputError
        If the graph has no factors.
    """
    if options is None:
        fix: Iterable[int] = keywords.pop("fix", ())
        options = OptimizeOptions(fix=tuple(fix), **keywords)
    elif keywords:
        raise TypeError("give either options or keywords")
    return _Run(graph, options, on_iteration or (lambda chi2, record: None), interrupted).result()


class _Run:
    """State of one run; ``result`` is its course."""

    def __init__(
        self, graph: FactorGraph, options: OptimizeOptions, on_iteration: OnIteration, interrupted: Callable[[], bool]
    ) -> None:
        self.graph = graph.with_fixed(options.fix)
        self.options = options
        self.on_iteration = on_iteration
        self.interrupted = interrupted
        self.stopwatch = Stopwatch()
        self.trace: list[IterationRecord] = []

    def result(self) -> Result:
        if not self.graph.factors:
            raise InputError("the graph has no edge that slamcli can use: nothing to optimize")
        with self.stopwatch.phase("gauge"):
            self.gauge, self.held = gauge.choose(self.graph)
        with self.stopwatch.phase("check"):
            defect = diagnosis.indefinite_information(self.graph)
        all_held = all(mask.all() for mask in self.held.values())
        steps_first = self.options.init == "auto" and not all_held  # a step from each candidate
        problem = self._problem() if steps_first else None
        try:
            with self.stopwatch.phase("init"):
                values, self.start = initialize(self.graph, self.options.init, self.held, problem)
        except NumericalError as error:
            values, self.start, defect = self.graph.values, NO_START, (error.message, error.details)
        if defect is not None:
            return self._not_started(values, Verdict(Status.FAILED, defect[0]), defect[1])
        if all_held:
            return self._not_started(values, Verdict(Status.CONVERGED, "all variables are held: nothing to optimize"))
        return self._iterate(problem or self._problem(), values)

    def _problem(self) -> Problem:
        return Problem(self.graph, self.held, self.options, self.stopwatch)

    def _iterate(self, problem: Problem, values: Values) -> Result:
        now = problem.linearize(values)
        initial = now.chi2
        termination = Termination(self.options, initial)
        policy = policies.make(self.options)
        self.on_iteration(initial, None)
        if not now.is_finite:
            return self._failed(problem, now, initial, diagnosis.not_finite(self.graph, now))
        verdict = termination.at_start(now.gradient_norm)
        if now.gradient_norm == 0.0 and problem.full_step(now).singular:
            found = diagnosis.not_positive_definite(self.graph, self.held, problem, now)
            return self._failed(problem, now, initial, found)
        began = time.perf_counter()
        while verdict is None:
            start = time.perf_counter()
            try:
                step = policy.step(problem, now)
            except NotPositiveDefiniteError:
                reason, details = diagnosis.not_positive_definite(self.graph, self.held, problem, now)
                if now.chi2 > initial:
                    risen = f"chi2 had risen from {initial:.6g} to {now.chi2:.6g}: the run was diverging"
                    details = (f"{risen} (try --method lm, or another --init)", *details)
                return self._failed(problem, now, initial, (reason, details))
            if not step.system.is_finite:
                return self._failed(problem, now, initial, diagnosis.not_finite(self.graph, step.system))
            decrease, now = now.chi2 - step.system.chi2, step.system
            self._record(step, decrease, time.perf_counter() - start)
            seconds = time.perf_counter() - began
            verdict = termination.after(step, decrease, len(self.trace), seconds, partial(problem.full_step, now))
            if verdict is None and self.interrupted():
                verdict = Verdict(Status.INTERRUPTED, f"on request, after iteration {len(self.trace)}")
        return self._ended(problem, now.values, initial, now.chi2, verdict, ())

    def _record(self, step: Step, decrease: float, seconds: float) -> None:
        record = IterationRecord(
            iteration=len(self.trace) + 1,
            chi2=step.system.chi2,
            chi2_change=-decrease,
            gradient_norm=step.system.gradient_norm,
            step_norm=step.norm,
            damping=step.damping,
            trials=step.trials,
            accepted=step.accepted,
            step=step.kind,
            time=seconds,
        )
        self.trace.append(record)
        self.on_iteration(record.chi2, record)

    def _not_started(self, values: Values, verdict: Verdict, details: tuple[str, ...] = ()) -> Result:
        chi2 = self.graph.chi2(values) if self.start != NO_START else math.nan
        return self._ended(None, values, chi2, chi2, verdict, details)

    def _failed(
        self, problem: Problem, now: LinearSystem, initial: float, found: tuple[str, tuple[str, ...]]
    ) -> Result:
        return self._ended(problem, now.values, initial, now.chi2, Verdict(Status.FAILED, found[0]), found[1])

    def _ended(
        self,
        problem: Problem | None,
        values: Values,
        initial: float,
        final: float,
        verdict: Verdict,
        details: tuple[str, ...],
    ) -> Result:
        return Result(
            graph=self.graph.with_values(values),
            options=self.options,
            gauge=self.gauge,
            status=verdict.status,
            reason=verdict.reason,
            start=self.start,
            initial_chi2=initial,
            final_chi2=final,
            dof=self.graph.degrees_of_freedom(self.held),
            trace=self.trace,
            diagnosis=details,
            time=self.stopwatch.seconds,
            problem=problem,
        )
