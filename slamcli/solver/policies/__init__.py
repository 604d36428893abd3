"""The methods by name."""

from __future__ import annotations

from slamcli.solver.options import OptimizeOptions
from slamcli.solver.policies.automatic import Automatic
from slamcli.solver.policies.dogleg import Dogleg
from slamcli.solver.policies.gauss_newton import GaussNewton
from slamcli.solver.policies.levenberg_marquardt import LevenbergMarquardt
from slamcli.solver.policies.steps import Policy


def make(options: OptimizeOptions) -> Policy:
    """The policy of a method of ``options.METHODS``."""
    if options.method == "auto":
        return Automatic()
    if options.method == "lm":
        return LevenbergMarquardt(marquardt_scaling=options.scaling == "marquardt")
    return Dogleg() if options.method == "dogleg" else GaussNewton()
