"""A robust run: which closures to keep, then the optimization over what is kept.

``pcm`` keeps the consistent set, ``gnc`` and ``gnc-gm`` anneal over all closures from the odometry, ``pcm+gnc``
anneals from the consistent set and then looks at all others again, ``switchable`` optimizes switches along with the
poses. The outcome is polished by the ordinary optimization over the kept factors, so that its chi2 is a minimum.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slamcli.errors import InputError, NumericalError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, Values
from slamcli.models import SWITCH
from slamcli.models.base import Array
from slamcli.solver import bundle, diagnosis, gauge
from slamcli.solver.attempt import OnIteration
from slamcli.solver.initialization import initialize
from slamcli.solver.optimize import optimize
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.result import IterationRecord, Result, Status
from slamcli.solver.robust import pcm, rejection, switchable
from slamcli.solver.robust.closures import Closures
from slamcli.solver.robust.gnc import Annealing, Budget
from slamcli.solver.stopwatch import Stopwatch

#: The gate is set for this multiple of the noise that the closures show, but for no more than the stated noise where
#: that is larger than the shown one: real residuals have longer tails than normal ones. The first round of ``pcm+gnc``
#: has none, so that the false closures that are left in the consistent set find no shelter.
MARGIN = 4.0
#: While the set is sought, the noise may rise to this multiple of what it was judged to be.
_RISE = 2.0
#: Degrees of freedom that the first judgement of the noise counts for.
_PRIOR = 10.0
#: Rounds in which ``pcm+gnc`` looks at the rejected closures again, and those that it looks at, as multiples of the
#: gate.
_ROUNDS, _NEARLY = 6, 4.0


def run(
    graph: FactorGraph, options: OptimizeOptions, on_iteration: OnIteration, interrupted: Callable[[], bool]
) -> Result:
    """Optimize a graph with a method of ``options.ROBUST`` but ``none``.

    The result's graph has all factors; ``final_chi2`` and ``dof`` are those of the factors that are kept, and
    ``rejection`` says which these are. (With ``switchable``, ``final_chi2`` is the cost that was minimized.)

    Raises
    ------
    InputError
        If the graph has switches of its own.
    """
    if SWITCH.name in graph.variables:
        hint = ("  without --robust its switches are optimized along with the poses",)
        raise InputError("the graph has switchable loop closures: --robust has nothing to decide about them", hint)
    graph = bundle.with_intrinsics(graph, options.intrinsics).with_fixed(options.fix)
    closures = Closures.of(graph)
    _, held = gauge.choose(graph)
    plain = replace(options, robust="none")
    hopeless = not graph.factors or diagnosis.indefinite_information(graph) is not None
    if hopeless or len(closures) == 0 or all(mask.all() for mask in held.values()):
        result = optimize(graph, options=plain, on_iteration=on_iteration, interrupted=interrupted)
        return _finished(result, graph, options, [np.ones(len(f)) for f in graph.factors], None)
    if options.robust == "switchable":
        return _switchable(graph, closures, options, plain, on_iteration, interrupted)
    try:
        return _Selection(closures, held, options, on_iteration, interrupted).result()
    except NumericalError as error:
        chosen, _ = gauge.choose(graph)
        dof = graph.degrees_of_freedom(held)
        return Result(
            graph,
            options,
            chosen,
            Status.FAILED,
            error.message,
            "robust",
            math.nan,
            math.nan,
            dof,
            diagnosis=error.details,
        )


class _Selection:
    """A run of a method that decides which closures to keep."""

    def __init__(
        self,
        closures: Closures,
        held: gauge.Held,
        options: OptimizeOptions,
        on_iteration: OnIteration,
        interrupted: Callable[[], bool],
    ) -> None:
        self.closures = closures
        self.held = held
        self.options = options
        self.on_iteration = on_iteration
        self.interrupted = interrupted
        self.began = time.perf_counter()
        self.stopwatch = Stopwatch()
        self.trace: list[IterationRecord] = []
        self.initial = math.nan
        self.variance = 1.0 if options.noise_scale is None else options.noise_scale**2
        self.judged = self.variance
        self.quantile = closures.quantile(options.robust_probability)
        self.words = ""
        self.margin = MARGIN
        self.cut = False

    def result(self) -> Result:
        method = self.options.robust
        if method in ("pcm", "pcm+gnc"):
            with self.stopwatch.phase("consistency"):
                chosen = pcm.consistent(self.closures, self.options.robust_probability, self.options.noise_scale)
            self.variance = self.judged = chosen.scale**2
            if method == "pcm":
                return self._optimized(chosen.keep, None)
            values, keep = self._from_consistent(chosen)
        else:
            everything = np.ones(len(self.closures), dtype=bool)
            values = self._start(np.zeros(len(self.closures), dtype=bool), "odometry")
            values, keep = self._annealed(everything, values, gm=method == "gnc-gm")
        return self._optimized(keep, values)

    def _from_consistent(self, chosen: pcm.ConsistentSet) -> tuple[Values, BoolArray]:
        """Annealing from the supported part of the consistent set, then over what might belong to it as well."""
        active = chosen.supported if chosen.supported.any() else chosen.keep
        values = self._start(active, "chordal")
        keep: BoolArray | None = None
        for number in range(_ROUNDS):
            before = keep
            self.margin = MARGIN if number else 1.0
            values, keep = self._annealed(active, values, trusted=before)
            nearly = self.closures.chi2(values) <= _NEARLY * self._gate()
            wanted = keep | chosen.keep | nearly
            stands = before is not None and (np.array_equal(keep, before) or np.array_equal(wanted, active))
            if self._stop() or stands:
                break
            active = wanted
        assert keep is not None
        return values, keep

    def _start(self, active: BoolArray, method: str) -> Values:
        """Values to start from: by ``--init`` where that names a start, else by the method that is given."""
        method = method if self.options.init == "auto" else self.options.init
        with self.stopwatch.phase("init"):
            values, words = initialize(self.closures.subgraph(active), method, self.held)
        self.words = f"{words} over the odometry" + (f" and {active.sum()} consistent closures" if active.any() else "")
        return values

    def _annealed(
        self, active: BoolArray, values: Values, *, gm: bool = False, trusted: BoolArray | None = None
    ) -> tuple[Values, BoolArray]:
        """Graduated non-convexity over some of the closures: the state, and which of all are kept."""
        part = Closures.of(self.closures.subgraph(active))
        budget = Budget(self._record, self._stop, len(self.trace))
        annealing = Annealing(part, self.held, self.options, self.stopwatch, values, budget)
        if not self.trace:
            self.initial = self.closures.graph.chi2(values)
            self.on_iteration(self.options.robust, self.initial, None)
        annealing.anneal(self._gate()[active], gm=gm, trusted=None if trusted is None else trusted[active])
        stated = self.variance

        def gate() -> Array:
            if self.options.noise_scale is None and annealing.weight.any() and self.margin == MARGIN:
                found = annealing.variance(stated, _PRIOR)
                self.variance = min(found, _RISE**2 * self.judged)
            return self._gate()[active]

        annealing.settle(gate)
        keep = np.zeros(len(self.closures), dtype=bool)
        keep[active] = annealing.weight >= rejection.LEAST_WEIGHT
        return annealing.values, keep

    def _gate(self) -> Array:
        """(c,) largest chi2 of a closure that is kept."""
        found = self.variance
        if self.options.noise_scale is None:
            found = max(found, min(self.margin**2 * found, 1.0))
        return self.quantile * found

    def _record(self, record: IterationRecord) -> None:
        self.trace.append(record)
        self.on_iteration(self.options.robust, record.chi2, record)

    def _stop(self) -> bool:
        limit = self.options.time_limit
        self.cut |= self.interrupted() or (limit is not None and time.perf_counter() - self.began >= limit)
        return self.cut

    def _optimized(self, keep: BoolArray, values: Values | None) -> Result:
        """The ordinary optimization over what is kept, from given values or from the start that was asked for."""
        graph = self.closures.graph
        kept = self.closures.subgraph(keep)
        options = replace(self.options, robust="none", fix=())
        if values is not None:
            kept, options = kept.with_values(values), replace(options, init="file")
        if options.time_limit is not None:
            spent = time.perf_counter() - self.began
            options = replace(options, time_limit=max(options.time_limit - spent, 1e-6))
        offset = len(self.trace)

        def watch(start: str, chi2: float, record: IterationRecord | None) -> None:
            if record is not None or offset == 0:
                moved = None if record is None else replace(record, iteration=offset + record.iteration)
                self.on_iteration(self.options.robust if offset else start, chi2, moved)

        result = optimize(kept, options=options, on_iteration=watch, interrupted=self.interrupted)
        last = [replace(record, iteration=offset + record.iteration) for record in result.trace]
        for phase, seconds in self.stopwatch.seconds.items():
            result.time[phase] = result.time.get(phase, 0.0) + seconds
        result.trace = self.trace + last
        if self.cut and result.status is not Status.FAILED:
            result.status = Status.INTERRUPTED if self.interrupted() else Status.NOT_CONVERGED
            why = "on request" if self.interrupted() else f"time limit of {self.options.time_limit:g} s used up"
            result.reason = f"{why}, before it was clear which closures to keep"
        if self.trace:
            result.initial_chi2, result.start = self.initial, self.words
        weight = self.closures.spread(keep.astype(np.float64))
        return _finished(result, graph, self.options, weight, math.sqrt(self.variance))


def _finished(
    result: Result, graph: FactorGraph, options: OptimizeOptions, weight: list[Array], scale: float | None
) -> Result:
    """The result of the kept part as that of the whole graph, with what was rejected."""
    whole = graph.with_values({name: result.graph.values[name] for name in graph.variables})
    chosen, held = gauge.choose(graph, options.gauge)
    found = rejection.of_weights(whole, weight, options, chosen.degrees_of_freedom(graph, held), scale)
    return replace(result, graph=whole, options=options, rejection=found)


def _switchable(
    graph: FactorGraph,
    closures: Closures,
    options: OptimizeOptions,
    plain: OptimizeOptions,
    on_iteration: OnIteration,
    interrupted: Callable[[], bool],
) -> Result:
    """Switches and poses are optimized together; the switches then tell the weights."""
    spread = switchable.with_switches(graph, closures.masks)
    init = "odometry" if plain.init == "auto" else plain.init  # a relaxation would believe every closure
    result = optimize(
        spread, options=replace(plain, fix=(), init=init), on_iteration=on_iteration, interrupted=interrupted
    )
    weight = switchable.source_weights(result.graph, closures.masks)
    back = replace(result, graph=switchable.without_switches(result.graph, graph))
    return _finished(back, graph, options, weight, None)
