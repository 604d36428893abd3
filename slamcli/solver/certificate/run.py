"""An optimization of either objective, with a certificate of the isotropic one if that is wanted."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from slamcli.errors import ExitCode, UsageError
from slamcli.graph import FactorGraph
from slamcli.solver.attempt import OnIteration
from slamcli.solver.certificate import isotropic
from slamcli.solver.certificate.certificate import RESTARTS, Certificate, CertificateStatus, is_robust
from slamcli.solver.certificate.comparison import SAME, ObjectiveGap, compare
from slamcli.solver.optimize import optimize
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.result import Result, Status

OBJECTIVES = ("g2o", "isotropic")
#: ``Result.start`` where the search for a certified minimum found a lower cost than the run.
_FROM_CERTIFICATE = "search for a certified minimum (--certify)"


@dataclass(frozen=True, eq=False)
class CertifiedRun:
    """A run with what was found out about its optimum.

    Attributes
    ----------
    objective
        What was minimized: ``g2o`` (chi2) or ``isotropic``. The costs of the result are in its terms.
    result
        The run, or the better one that the certificate led to. Its graph has the factors of the file in either case.
    minimized
        The graph whose chi2 was minimized, at the result.
    certificate
        If one was asked for and the run has a result.
    gap
        Between the objectives, if chi2 was minimized and the certificate is applicable.
    time
        Seconds that the certificate took.
    """

    objective: str
    result: Result
    minimized: FactorGraph
    certificate: Certificate | None = None
    gap: ObjectiveGap | None = None
    time: float = 0.0

    @cached_property
    def chi2(self) -> float:
        """chi2 in g2o's definition at the result, whatever was minimized."""
        return self.result.final_chi2 if self.objective == "g2o" else self.result.graph.chi2()

    @property
    def exit_code(self) -> ExitCode:
        """That of the run; where it converged, 1 if there should be a certificate and is none."""
        code = self.result.exit_code
        if code == ExitCode.SUCCESS and self.certificate is not None and not self.certificate.certified:
            return ExitCode.CHECK_FAILED
        return code


def run(
    graph: FactorGraph,
    *,
    objective: str = "g2o",
    certified: bool = False,
    restarts: Sequence[str] = RESTARTS,
    options: OptimizeOptions | None = None,
    on_iteration: OnIteration | None = None,
    interrupted: Callable[[], bool] = lambda: False,
) -> CertifiedRun:
    """Minimize an objective; with ``certified``, certify the minimum of the isotropic one and use what that finds.

    Parameters
    ----------
    graph
        As it was read.
    objective
        ``g2o`` or ``isotropic``.
    certified
        Whether to certify.
    restarts
        What is tried where a certificate fails (see ``certify``).
    options, on_iteration, interrupted
        See ``optimize``.

    Raises
    ------
    UsageError
        If the objective does not exist, or a robust estimate is to be certified.
    InputError
        If the isotropic objective is not defined for the graph.
    """
    options = options or OptimizeOptions()
    if objective not in OBJECTIVES:
        raise UsageError(f"objective {objective!r} does not exist", (f"  one of: {', '.join(OBJECTIVES)}",))
    if certified and is_robust(options):
        hint = ("  --certify goes with neither --kernel nor --robust",)
        raise UsageError("there is no certificate for a robust estimate", hint)
    if objective == "g2o":
        result = optimize(graph, options=options, on_iteration=on_iteration, interrupted=interrupted)
        outcome = CertifiedRun(objective, result, result.optimized)
    else:
        transformed = isotropic.transform(graph)
        found = optimize(transformed, options=options, on_iteration=on_iteration, interrupted=interrupted)
        result = replace(found, graph=replace(found.graph, factors=graph.factors))
        outcome = CertifiedRun(objective, result, found.graph)
    if not certified or result.status in (Status.FAILED, Status.INTERRUPTED):
        return outcome
    began = time.perf_counter()
    outcome = _certified(outcome, restarts, interrupted)
    return replace(outcome, time=time.perf_counter() - began)


def _certified(outcome: CertifiedRun, restarts: Sequence[str], interrupted: Callable[[], bool]) -> CertifiedRun:
    """The outcome with a certificate, at what the certificate led to where that is better."""
    from slamcli.solver.certificate.certify import certify, inapplicable  # a plain run starts without them

    result = outcome.result
    reason = inapplicable(result.graph, result.options)
    if reason is not None:
        return replace(outcome, certificate=Certificate(CertificateStatus.INAPPLICABLE, reason))
    certificate = certify(
        result.graph,
        options=result.options,
        minimized=result if outcome.objective == "isotropic" else None,
        restarts=restarts,
        interrupted=interrupted,
    )
    outcome = replace(outcome, certificate=certificate)
    assert certificate.graph is not None
    if outcome.objective == "g2o":
        gap, better = compare(result, certificate, interrupted=interrupted)
        return replace(outcome, gap=gap, result=better, minimized=better.graph)
    if certificate.cost < (1.0 - SAME) * result.final_chi2:
        values = certificate.graph.values
        start = _FROM_CERTIFICATE if certificate.escapes else result.start
        better = replace(result, graph=result.graph.with_values(values), final_chi2=certificate.cost, start=start)
        return replace(outcome, result=better, minimized=certificate.graph)
    return outcome
