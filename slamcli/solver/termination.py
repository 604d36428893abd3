"""When an optimization ends: one test for all methods, which says its reason in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from slamcli.solver.options import OptimizeOptions
from slamcli.solver.policies.steps import Step
from slamcli.solver.problem import FullStep
from slamcli.solver.result import Status

#: A decrease below this share of chi2, or below that share of chi2 at the start, is rounding.
_ROUNDING, _ROUNDING_AT_START = 1e-14, 1e-17
#: A verdict on damped steps stands if the full step promises no more than this times the tolerance.
_CONFIRM = 10.0
#: The decrease still to come is extrapolated only from steps that already change chi2 by less than this share of it.
_NEAR = 1e-3
#: Kinds of steps that are neither damped nor cut nor extrapolated.
_FULL = ("gauss-newton", "simplified-newton")
#: No variable moved by more than this (metres, radians): nothing is left to gain in double precision.
_SMALLEST_STEP = 1e-12


@dataclass(frozen=True)
class Verdict:
    """That and why a run ends."""

    status: Status
    reason: str


class Termination:
    """Watches chi2, gradient and steps.

    chi2 converges at least linearly near a minimum: with d the last two decreases and r = d_k / d_(k-1), what is
    still to come is about d_k r / (1 - r) (Aitken). Where Gauss-Newton converges quadratically, this sees one
    iteration earlier than the last decrease itself that there is nothing left to gain; on a slow tail it does not
    stop too early.

    Parameters
    ----------
    options
        Tolerance and budgets.
    initial_chi2
        At the start.
    floor
        chi2 of residuals that are rounding alone (see ``Problem.rounding``).
    """

    def __init__(self, options: OptimizeOptions, initial_chi2: float, floor: float = 0.0) -> None:
        self._options = options
        self._least = max(_ROUNDING_AT_START * initial_chi2, floor)
        self._previous = 0.0

    def at_start(self, gradient_norm: float) -> Verdict | None:
        """Whether there is nothing to do."""
        if gradient_norm == 0.0:
            return Verdict(Status.CONVERGED, "the gradient is zero at the start")
        if self._options.max_iterations == 0:
            return Verdict(Status.NOT_CONVERGED, "no iterations allowed")
        return None

    def after(
        self, step: Step, decrease: float, iterations: int, seconds: float, full_step: Callable[[], FullStep]
    ) -> Verdict | None:
        """Whether a run ends after an iteration that lowered chi2 by ``decrease``.

        Damped and cut steps can be short far from any minimum. What they seem to show must be confirmed by
        what the full Gauss-Newton step promises from here.
        """
        verdict = self._converged(step, decrease)
        if verdict is not None and step.kind not in _FULL:
            verdict = self._confirmed(verdict, step, full_step())
        if verdict is not None:
            return verdict
        if step.accepted:
            self._previous = decrease
        options = self._options
        if iterations >= options.max_iterations:
            return Verdict(Status.NOT_CONVERGED, f"iteration limit {iterations} reached")
        if options.time_limit is not None and seconds >= options.time_limit:
            return Verdict(Status.NOT_CONVERGED, f"time limit of {options.time_limit:g} s used up")
        return None

    def _confirmed(self, verdict: Verdict, step: Step, full: FullStep) -> Verdict | None:
        """The verdict on damped steps in the light of what the full step promises."""
        chi2 = step.system.chi2
        least = max(_CONFIRM * self._options.tolerance * chi2, _ROUNDING * chi2, self._least)
        # no step gains more than all of chi2
        if min(full.decrease, chi2) <= least or full.largest <= _SMALLEST_STEP:
            more = "; H is singular: other minima are as good" if full.singular else ""
            return Verdict(verdict.status, verdict.reason + more)
        if step.accepted:
            return None
        return Verdict(Status.NOT_CONVERGED, f"no step lowers chi2 after {step.trials} trials")

    def _converged(self, step: Step, decrease: float) -> Verdict | None:
        chi2, tolerance = step.system.chi2, self._options.tolerance
        if step.system.gradient_norm == 0.0:
            return Verdict(Status.CONVERGED, "the gradient is zero")
        if not step.accepted:
            return Verdict(Status.CONVERGED, f"no step lowers chi2 after {step.trials} trials, and none promises to")
        if step.largest <= _SMALLEST_STEP:
            return Verdict(Status.CONVERGED, f"no variable moved by more than {_SMALLEST_STEP:g}")
        if abs(decrease) <= max(_ROUNDING * chi2, self._least):
            return Verdict(Status.CONVERGED, "chi2 changes by no more than rounding")
        if abs(decrease) <= tolerance * chi2:
            share = abs(decrease) / chi2
            return Verdict(Status.CONVERGED, f"relative change of chi2 {share:.1e} is below {tolerance:.0e}")
        if step.kind in _FULL and 0.0 < decrease < min(self._previous, _NEAR * chi2):
            ratio = decrease / self._previous
            to_come = decrease * ratio / (1.0 - ratio) / chi2
            if to_come <= tolerance:
                reason = (
                    f"relative decrease of chi2 still to come {to_come:.1e} (extrapolated) is below {tolerance:.0e}"
                )
                return Verdict(Status.CONVERGED, reason)
        return None
