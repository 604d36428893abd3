"""What a certified minimum of the isotropic chordal objective says about chi2, which is another objective.

The two have different minima, mostly close together. So the certified solution is one more start for chi2, one that
owes nothing to the guess: the run's result is confirmed where both lead to the same chi2, and replaced where this start
leads lower. That proves nothing about chi2 itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from slamcli.solver.certificate.certificate import Certificate
from slamcli.solver.optimize import optimize
from slamcli.solver.result import Result, Status

#: Two minima of chi2 are the same where they differ by less than this share, or by less than this.
SAME, NOTHING = 1e-6, 1e-9
#: ``Result.start`` of a run that replaced the result.
_START = "minimum of the isotropic chordal objective (--certify)"


@dataclass(frozen=True)
class ObjectiveGap:
    """The run's minimum of chi2 beside the solution of the certificate.

    Attributes
    ----------
    isotropic_at_result
        The isotropic objective at the run's result.
    isotropic_minimum
        At the solution of the certificate.
    chi2_at_minimum
        chi2 at that solution.
    chi2_polished
        chi2 of a run that starts there; None if that run failed.
    chi2_result
        chi2 of the run's result.
    lower
        Whether the run from there ended lower, so that it was taken in place of the result.
    """

    isotropic_at_result: float
    isotropic_minimum: float
    chi2_at_minimum: float
    chi2_polished: float | None
    chi2_result: float
    lower: bool

    @property
    def relative(self) -> float:
        """By how much the isotropic objective at the result exceeds its minimum, as a share of the minimum."""
        least = self.isotropic_minimum
        return (self.isotropic_at_result - least) / least if least > 0.0 else 0.0

    @property
    def same(self) -> bool:
        """Whether both starts lead to the same chi2."""
        return self.chi2_polished is not None and not _differ(self.chi2_polished, self.chi2_result)


def compare(
    result: Result, certificate: Certificate, *, interrupted: Callable[[], bool] = lambda: False
) -> tuple[ObjectiveGap, Result]:
    """Polish the solution of a certificate in chi2; the gap, and the better one of both results."""
    graph = result.graph
    assert certificate.graph is not None
    start = graph.with_values(certificate.graph.values)
    other = optimize(start, options=replace(result.options, init="file"), interrupted=interrupted)
    usable = other.status is not Status.FAILED
    lower = usable and other.final_chi2 < result.final_chi2 and _differ(other.final_chi2, result.final_chi2)
    gap = ObjectiveGap(
        isotropic_at_result=certificate.estimate_cost,
        isotropic_minimum=certificate.cost,
        chi2_at_minimum=start.chi2(),
        chi2_polished=other.final_chi2 if usable else None,
        chi2_result=result.final_chi2,
        lower=lower,
    )
    if not lower:
        return gap, result
    time = {phase: result.time.get(phase, 0.0) + seconds for phase, seconds in other.time.items()}
    return gap, replace(other, options=result.options, start=_START, time=time)


def _differ(chi2: float, reference: float) -> bool:
    return not abs(chi2 - reference) <= SAME * reference + NOTHING
