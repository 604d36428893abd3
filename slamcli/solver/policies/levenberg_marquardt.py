"""Levenberg-Marquardt with g2o's control of the damping.

(H + lambda D) delta = -g with D = I, or the diagonal of H with Marquardt scaling. With rho the actual decrease of
chi2 over the predicted one (Nielsen 1999, as in g2o's ``OptimizationAlgorithmLevenberg``):

* accepted (rho > 0): lambda *= max(1/3, min(2/3, 1 - (2 rho - 1)^3)), nu = 2
* rejected: lambda *= nu, nu *= 2; at most ten trials in one iteration

Where the step is found by conjugate gradients it is inexact; what it promises is by the same formula.
"""

from __future__ import annotations

import numpy as np

from slamcli.models.base import dot, norm
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.policies.steps import Step
from slamcli.solver.problem import Problem

_INITIAL = 1e-5  # of the largest diagonal entry of H, as in g2o
_INITIAL_SCALED = 1e-4  # of each diagonal entry, as in Ceres; with 1e-6 Ladybug-49 ends in a worse minimum
_TRIALS = 10
# Of the largest diagonal entry: variables that no edge moves are damped, too. It is far below what distant points have,
# which are to be damped no more than in proportion: with 1e-9, Ladybug-49 takes 57 iterations instead of 22.
_LEAST_SCALE = 1e-15


class LevenbergMarquardt:
    """Damped steps that never raise chi2.

    Parameters
    ----------
    marquardt_scaling
        Damp in proportion to the diagonal of H.
    """

    def __init__(self, marquardt_scaling: bool = False) -> None:
        self._scaled = marquardt_scaling
        self._lambda = 0.0
        self._nu = 2.0
        self._taken_at_once = False

    def step(self, problem: Problem, now: LinearSystem) -> Step:
        """Try steps with rising damping until one lowers chi2."""
        diagonal = problem.diagonal(now)
        least = _LEAST_SCALE * float(diagonal.max(initial=0.0))
        scale = np.maximum(diagonal, least) if self._scaled else np.ones_like(diagonal)
        if self._lambda == 0.0:
            self._lambda = _INITIAL_SCALED if self._scaled else _INITIAL * float(diagonal.max(initial=0.0))
        delta, values, rho, solved, trials = np.zeros_like(diagonal), now.values, -1.0, False, 0
        system: LinearSystem | None = None
        while trials < _TRIALS:
            trials += 1
            damping = self._lambda * scale
            try:
                delta = problem.solve(now, damping, inexact=True)
                solved = True
                values = problem.retract(now.values, delta)
                predicted = dot(delta, damping * delta - now.gradient)
                # chi2 tells whether to linearize there; after a step that was taken at once the next one is, too
                system = problem.linearize(values) if trials == 1 and self._taken_at_once else None
                decrease = now.chi2 - (problem.chi2(values) if system is None else system.chi2)
                rho = decrease / predicted if predicted > 0.0 and np.isfinite(decrease) else -1.0
            except NotPositiveDefiniteError:
                rho = -1.0
            if rho > 0.0:
                break
            self._lambda *= self._nu
            self._nu *= 2.0
        if not solved:
            raise NotPositiveDefiniteError("H is not positive definite under any damping that was tried")
        self._taken_at_once = rho > 0.0 and trials == 1
        if rho > 0.0:
            self._lambda *= max(1.0 / 3.0, min(2.0 / 3.0, 1.0 - (2.0 * rho - 1.0) ** 3))
            self._nu = 2.0
        return Step(
            system=now if rho <= 0.0 else system or problem.linearize(values),
            norm=norm(delta),
            largest=float(np.abs(delta).max(initial=0.0)),
            damping=self._lambda,
            trials=trials,
            accepted=rho > 0.0,
            kind="damped",
            gain=rho if solved else None,
        )
