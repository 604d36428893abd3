"""Optimizes a graph: gauge, start, setup, then the iterations from one start or, in doubt, from several."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from slamcli.errors import InputError, NumericalError
from slamcli.graph import FactorGraph
from slamcli.solver import bundle, diagnosis, gauge, initialization, multistart, scene_checks
from slamcli.solver.attempt import Attempt, OnIteration
from slamcli.solver.initialization import Start
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.problem import Problem
from slamcli.solver.result import Result, StartRecord, Status
from slamcli.solver.robust import kernels
from slamcli.solver.stopwatch import Stopwatch
from slamcli.solver.termination import Verdict

#: ``Result.start`` of a run that found no values to start from; its chi2 is NaN.
NO_START = "no start"


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
    watch: OnIteration = on_iteration or (lambda start, chi2, record: None)

    def once(graph: FactorGraph, options: OptimizeOptions) -> Result:
        if options.robust != "none":
            from slamcli.solver.robust.run import run  # it optimizes, too

            return run(graph, options, watch, interrupted)
        return _Run(graph, options, watch, interrupted).result()

    if graph.landmarks == 0:
        return once(graph, options)
    from slamcli.solver import landmark_run  # most graphs do without

    return landmark_run.run(graph, options, once)


class _Run:
    """State of one run; ``result`` is its course."""

    def __init__(
        self, graph: FactorGraph, options: OptimizeOptions, on_iteration: OnIteration, interrupted: Callable[[], bool]
    ) -> None:
        self.graph = bundle.with_intrinsics(graph, options.intrinsics).with_fixed(options.fix)
        self.options = bundle.adapted(options, graph)
        self._scene = options.method == "auto" and bundle.has_projections(graph)
        self.on_iteration = on_iteration
        self.interrupted = interrupted
        self.stopwatch = Stopwatch()
        self.starts: dict[str, StartRecord] = {}
        self.doubt: str | None = None
        self.began = time.perf_counter()

    def result(self) -> Result:
        if not self.graph.factors:
            raise InputError("the graph has no edge that slamcli can use: nothing to optimize")
        scene_checks.require_finite(self.graph)
        _require_fixed_places(self.graph)
        with self.stopwatch.phase("gauge"):
            self.gauge, self.held = gauge.choose(self.graph, self.options.gauge)
        with self.stopwatch.phase("check"):
            defect = diagnosis.indefinite_information(self.graph)
        try:
            scene_checks.check(self.graph)
            if defect is not None:
                return self._not_started(Verdict(Status.FAILED, defect[0]), defect[1])
            if all(mask.all() for mask in self.held.values()):
                return self._not_started(Verdict(Status.CONVERGED, "all variables are held: nothing to optimize"))
            return self._automatic() if self.options.init == "auto" else self._single()
        except NumericalError as error:
            return self._nowhere(Verdict(Status.FAILED, error.message), error.details)

    def _problem(self) -> Problem:
        losses = kernels.losses(self.graph, self.options)
        return Problem(self.graph, self.held, self.options, self.stopwatch, losses, frozen=self.gauge.frozen)

    def _single(self) -> Result:
        """One run from the start that was asked for."""
        start = self._make(partial(initialization.make, self.graph, self.options.init, self.held))
        attempt = self._begin(self._problem(), start)
        self._to_the_end(attempt)
        if self._scene and not attempt.failed and not self.interrupted():
            attempt = self._with_points_in_front(attempt)
        return self._ended(attempt)

    def _with_points_in_front(self, attempt: Attempt) -> Attempt:
        """The run, or if it took points behind cameras a lower one with other damping."""
        gone = bundle.gone_behind(self.graph, attempt.start.values, attempt.now.values)
        if gone == 0:
            return attempt
        self.doubt = f"{gone} observations have their point behind the camera, which was in front of it at the start"
        start = replace(attempt.start, name="file-unscaled", words=f"{attempt.start.words}, damping without scaling")
        options = replace(self.options, scaling="none")
        attempts = [attempt, Attempt(attempt.problem, start, options, self.on_iteration, self.began)]
        self._to_the_end(attempts[1])
        self.starts = {one.start.name: StartRecord.of(one) for one in attempts}
        best = multistart.best(attempts)
        if best is attempts[1]:
            self.options = options
        return best

    def _automatic(self) -> Result:
        """See ``multistart``."""
        problem = self._problem()
        dof = None if problem.robust else self.gauge.degrees_of_freedom(self.graph, self.held)

        def chi2(start: Start) -> float:
            cost = problem.chi2(start.values)
            self.starts[start.name] = StartRecord.unused(start, cost)
            return cost

        def ranked(starts: Iterator[Callable[[], Start]]) -> list[tuple[float, Start]]:
            return multistart.ranked((partial(self._make, make) for make in starts), chi2, dof)

        starts = initialization.automatic(self.graph, self.held, trust_closures=not problem.robust)
        (lowest, first), *others = ranked(starts)  # those after a good one are not made
        attempts = [self._begin(problem, first)]
        self._to_the_end(attempts[0], until=multistart.erratic)
        if self.interrupted():
            attempts[0].interrupt()
        elif self.options.max_iterations > 0:
            self.doubt = multistart.doubt(attempts[0], dof, from_file=first.name == "file")
        if self.doubt is not None:
            others += ranked(starts) + ranked(initialization.in_doubt(self.graph, self.held))
            for start in multistart.worth_a_run(others, lowest):
                attempts.append(self._begin(problem, start))
                self._to_the_end(attempts[-1])
            if multistart.best(attempts) is attempts[0]:
                self._to_the_end(attempts[0])
            attempts[0].leave()
        for attempt in attempts:
            self.starts[attempt.start.name] = StartRecord.of(attempt)
        return self._ended(multistart.best(attempts))

    def _make(self, make: Callable[[], Start]) -> Start:
        with self.stopwatch.phase("init"):
            return make()

    def _begin(self, problem: Problem, start: Start) -> Attempt:
        return Attempt(problem, start, self.options, self.on_iteration, self.began)

    def _to_the_end(self, attempt: Attempt, until: Callable[[Attempt], bool] = lambda attempt: False) -> None:
        while attempt.verdict is None and not until(attempt):
            attempt.advance()
            if attempt.verdict is None and self.interrupted():
                attempt.interrupt()

    def _not_started(self, verdict: Verdict, details: tuple[str, ...] = ()) -> Result:
        """A run that has nothing to do or cannot begin, at its start."""
        method = "file" if self.options.init == "auto" else self.options.init
        try:
            start = self._make(partial(initialization.make, self.graph, method, self.held))
        except NumericalError:
            if verdict.status is not Status.FAILED:
                raise
            return self._nowhere(verdict, details)  # what cannot begin needs no start
        return self._outcome(start, verdict, self.graph.chi2(start.values), details=details)

    def _nowhere(self, verdict: Verdict, details: tuple[str, ...]) -> Result:
        return self._outcome(Start(NO_START, self.graph.values, NO_START), verdict, math.nan, details=details)

    def _ended(self, attempt: Attempt) -> Result:
        details = attempt.diagnose(self.graph, self.held)
        assert attempt.verdict is not None
        return self._outcome(attempt.start, attempt.verdict, attempt.initial, attempt=attempt, details=details)

    def _outcome(
        self,
        start: Start,
        verdict: Verdict,
        initial: float,
        *,
        attempt: Attempt | None = None,
        details: tuple[str, ...],
    ) -> Result:
        return Result(
            graph=self.graph.with_values(start.values if attempt is None else attempt.now.values),
            options=self.options,
            gauge=self.gauge,
            status=verdict.status,
            reason=verdict.reason,
            start=start.words,
            initial_chi2=initial,
            final_chi2=initial if attempt is None else attempt.chi2,
            dof=self.gauge.degrees_of_freedom(self.graph, self.held),
            trace=[] if attempt is None else attempt.trace,
            starts=list(self.starts.values()),
            doubt=self.doubt,
            diagnosis=details,
            time=self.stopwatch.seconds,
            problem=None if attempt is None else attempt.problem,
        )


def _require_fixed_places(graph: FactorGraph) -> None:
    """Refuse landmarks that are held fixed nowhere."""
    for name, column in graph.variables.items():
        lost = column.fixed & ~column.known
        if column.kind.is_point and lost.any():
            raise InputError(
                f"{name} {column.ids[lost][0]} is fixed, and has no value to be held at",
                ("  give a vertex for it, or do not fix it",),
            )
