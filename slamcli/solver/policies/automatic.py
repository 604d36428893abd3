"""The default method: Gauss-Newton, watched, accelerated on slow tails, and left for a method that never raises chi2.

* Full Gauss-Newton steps. chi2 may rise: on the way into a basin it often does for a step or two, and methods that
  forbid it need ten times the iterations. But after ``PATIENCE`` steps without a new lowest chi2, or where H loses its
  definiteness or chi2 its finiteness, the run goes back to the best state and goes on with dogleg (Levenberg-Marquardt
  where H is not definite). This is the watchdog technique (Chamberlain, Powell, Lemarechal, Pedersen 1982).
* On a slow tail the steps are extrapolated (see ``acceleration``).
* A step that is about to be the last is solved for with the factor of the one before ("simplified Newton", Deuflhard
  2004, section 2.1): H hardly changes there, and the factorization is most of an iteration.
"""

from __future__ import annotations

import math

import numpy as np

from slamcli.models.base import Array, dot, norm
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.policies.acceleration import Acceleration
from slamcli.solver.policies.dogleg import Dogleg
from slamcli.solver.policies.levenberg_marquardt import LevenbergMarquardt
from slamcli.solver.policies.steps import Policy, Step
from slamcli.solver.problem import Problem

#: Steps without a new lowest chi2 before Gauss-Newton is given up. On M3500c it comes down after nine and ends at the
#: best optimum known; dogleg and Levenberg-Marquardt end higher.
PATIENCE = 10
#: The tail is slow where a decrease of less than this share of chi2 ...
_NEAR = 0.1
#: ... is more than this share of the one before.
_SLOW = 0.1
#: The factor serves once more where the last decrease was below this share of chi2 and of the decrease before.
_REUSE, _REUSE_RATIO = 1e-4, 0.05


class Automatic:
    """Watched Gauss-Newton with a fallback."""

    def __init__(self) -> None:
        self._best: LinearSystem | None = None
        self._without_progress = 0
        self._fallback: Policy | None = None
        self._acceleration = Acceleration()
        self._decreases = (math.nan, math.nan)  # of the last two steps
        self._factor_is_fresh = False

    def step(self, problem: Problem, now: LinearSystem) -> Step:
        """One iteration of what is in force."""
        if self._fallback is not None:
            return self._fallback.step(problem, now)
        if self._best is None:
            self._best = now
        try:
            step = self._newton(problem, now)
        except NotPositiveDefiniteError:
            if self._best is now:
                raise  # there is no better state: the edges do not determine all variables
            return self._fall_back(problem, LevenbergMarquardt())
        if not step.system.is_finite:
            return self._fall_back(problem, Dogleg()) if self._best is not now else step
        self._decreases = self._decreases[1], now.chi2 - step.system.chi2
        self._without_progress += 1
        if step.system.chi2 < self._best.chi2:
            self._best, self._without_progress = step.system, 0
        if self._without_progress >= PATIENCE:
            return self._fall_back(problem, Dogleg())
        return step

    def _fall_back(self, problem: Problem, policy: Policy) -> Step:
        """A step of another method from the best state."""
        self._fallback = policy
        assert self._best is not None
        return policy.step(problem, self._best)

    def _newton(self, problem: Problem, now: LinearSystem) -> Step:
        """A Gauss-Newton step: full, extrapolated, or with the last factor."""
        before, last = self._decreases
        if self._factor_is_fresh and 0.0 <= last <= min(_REUSE * now.chi2, _REUSE_RATIO * before):
            self._factor_is_fresh = False
            step = self._taken(problem, now, problem.solve_again(now), "simplified-newton")
            if step.system.chi2 <= now.chi2:
                self._acceleration.forget()
                return step
        delta = problem.solve(now)
        self._factor_is_fresh = True
        slow = abs(last) <= _NEAR * now.chi2 and abs(last) > _SLOW * abs(before)
        trials = 1
        if slow and self._acceleration.ready:
            taken = self._acceleration.extrapolated(delta, now.gradient)
            step = self._taken(problem, now, taken, "accelerated")
            if step.system.chi2 <= now.chi2:
                self._acceleration.moved(taken, delta, now.gradient)
                return step
            self._acceleration.forget()
            trials = 2
        self._acceleration.moved(delta, delta, now.gradient)
        return self._taken(problem, now, delta, "gauss-newton", trials)

    def _taken(self, problem: Problem, now: LinearSystem, delta: Array, kind: str, trials: int = 1) -> Step:
        system = problem.linearize(problem.retract(now.values, delta))
        promised = -dot(now.gradient, delta)
        return Step(
            system=system,
            norm=norm(delta),
            largest=float(np.abs(delta).max(initial=0.0)),
            damping=None,
            trials=trials,
            accepted=True,
            kind=kind,
            gain=(now.chi2 - system.chi2) / promised if kind == "gauss-newton" and promised > 0.0 else None,
        )
