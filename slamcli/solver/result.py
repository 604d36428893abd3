"""What an optimization returns: one record for each iteration, one result for the run."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING

from slamcli.errors import ExitCode
from slamcli.graph import FactorGraph
from slamcli.solver.gauge import Gauge
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.symbolic import Sparsity

if TYPE_CHECKING:
    from slamcli.solver.problem import Problem


class Status(StrEnum):
    """How a run ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not_converged"
    INTERRUPTED = "interrupted"
    FAILED = "numerical_failure"

    @property
    def exit_code(self) -> ExitCode:
        """The exit code of the command line for this status."""
        return {
            Status.CONVERGED: ExitCode.SUCCESS,
            Status.NOT_CONVERGED: ExitCode.NOT_CONVERGED,
            Status.INTERRUPTED: ExitCode.INTERRUPTED,
            Status.FAILED: ExitCode.NUMERICAL_FAILURE,
        }[self]


@dataclass(frozen=True)
class IterationRecord:
    """One iteration.

    Attributes
    ----------
    iteration
        Number, from 1.
    chi2
        After the step.
    chi2_change
        chi2 after the step minus chi2 before it.
    gradient_norm
        Largest component of the gradient J^T Omega e after the step.
    step_norm
        Euclidean norm of the tangent step.
    damping
        Levenberg-Marquardt's lambda, dogleg's trust radius, None for Gauss-Newton.
    trials
        Steps that were tried, the last one included.
    accepted
        Whether the last one was taken.
    step
        Kind of the step: ``gauss-newton``, ``damped``, ``steepest-descent`` or ``dogleg``.
    time
        Seconds.
    """

    iteration: int
    chi2: float
    chi2_change: float
    gradient_norm: float
    step_norm: float
    damping: float | None
    trials: int
    accepted: bool
    step: str
    time: float


@dataclass
class Result:
    """Outcome of an optimization.

    Attributes
    ----------
    graph
        The graph at the final values.
    options
        As they were in effect.
    gauge
        What was held.
    status, reason
        How the run ended, and why in words.
    diagnosis
        Details of a numerical failure, one line each.
    start
        Where the run started, in words.
    initial_chi2, final_chi2
        At the start and at the end.
    dof
        Residual dimensions minus free tangent dimensions.
    trace
        The iterations.
    time
        Seconds by phase: gauge, check, init, pattern, order, analyze, linearize, assemble, factorize, solve, retract.
    problem
        The linear problem of the run, for what is computed on demand; None if it was never built.
    """

    graph: FactorGraph
    options: OptimizeOptions
    gauge: Gauge
    status: Status
    reason: str
    start: str
    initial_chi2: float
    final_chi2: float
    dof: int
    trace: list[IterationRecord] = field(default_factory=list)
    diagnosis: tuple[str, ...] = ()
    time: dict[str, float] = field(default_factory=dict)
    problem: Problem | None = None

    @cached_property
    def sparsity(self) -> Sparsity | None:
        """Sparsity of the linear system, analyzed when it is first asked for; None if it was never built."""
        return None if self.problem is None else self.problem.sparsity

    @property
    def iterations(self) -> int:
        """Number of iterations."""
        return len(self.trace)

    @property
    def exit_code(self) -> ExitCode:
        """The exit code of the command line."""
        return self.status.exit_code
