"""Gauss-Newton: H delta = -g, every step taken."""

from __future__ import annotations

import numpy as np

from slamcli.models.base import norm
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.policies.steps import Step
from slamcli.solver.problem import Problem


class GaussNewton:
    """The plain step; chi2 may rise on the way."""

    def step(self, problem: Problem, now: LinearSystem) -> Step:
        """Solve, retract, linearize."""
        delta = problem.solve(now)
        system = problem.linearize(problem.retract(now.values, delta))
        return Step(
            system=system,
            norm=norm(delta),
            largest=float(np.abs(delta).max(initial=0.0)),
            damping=None,
            trials=1,
            accepted=True,
            kind="gauss-newton",
        )
