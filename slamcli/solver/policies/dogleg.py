"""Powell's dogleg: the Gauss-Newton step, cut to a trust region along the path from the steepest descent step.

Madsen, Nielsen, Tingleff 2004, "Methods for Non-Linear Least Squares Problems", section 3.3; the control of the radius
and its start are g2o's (``OptimizationAlgorithmDogleg``).
"""

from __future__ import annotations

import numpy as np

from slamcli.models.base import Array, dot, norm
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.policies.steps import Step
from slamcli.solver.problem import Problem

_INITIAL_RADIUS = 1e4
_TRIALS = 100


class Dogleg:
    """Trust-region steps that never raise chi2; one factorization in each iteration, whatever the trials."""

    def __init__(self) -> None:
        self._radius = _INITIAL_RADIUS

    def step(self, problem: Problem, now: LinearSystem) -> Step:
        """Shrink the trust region until a step lowers chi2."""
        newton = problem.solve(now)
        squared = dot(now.gradient, now.gradient)
        curvature = problem.pattern.quadratic_form(now.hessian, now.gradient)
        descent = -(squared / curvature if curvature > 0.0 else 0.0) * now.gradient
        trials, rho = 0, -1.0
        while trials < _TRIALS:
            trials += 1
            delta, kind = self._on_path(newton, descent)
            values = problem.retract(now.values, delta)
            predicted = problem.model_decrease(now, delta)
            decrease = now.chi2 - problem.chi2(values)
            rho = decrease / predicted if predicted > 0.0 and np.isfinite(decrease) else -1.0
            length = norm(delta)
            if rho > 0.75:
                self._radius = max(self._radius, 3.0 * length)
            elif rho < 0.25:
                self._radius = 0.5 * min(self._radius, length)
            if rho > 0.0 or length == 0.0:
                break
        return Step(
            system=problem.linearize(values) if rho > 0.0 else now,
            norm=length,
            largest=float(np.abs(delta).max(initial=0.0)),
            damping=self._radius,
            trials=trials,
            accepted=rho > 0.0,
            kind=kind,
            gain=rho,
        )

    def _on_path(self, newton: Array, descent: Array) -> tuple[Array, str]:
        """The point of the dogleg path at the trust radius, or the full Gauss-Newton step within it."""
        if norm(newton) <= self._radius:
            return newton, "gauss-newton"
        length = norm(descent)
        if length >= self._radius:
            return descent * (self._radius / length), "steepest-descent"
        leg = newton - descent
        # |descent + beta leg| = radius, with the root written so that nothing cancels
        a, b, c = dot(leg, leg), dot(descent, leg), self._radius**2 - length**2
        root = np.sqrt(b * b + a * c)
        beta = c / (b + root) if b > 0.0 else (root - b) / a
        return descent + beta * leg, "dogleg"
